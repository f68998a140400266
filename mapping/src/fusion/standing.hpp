#pragma once

#include "fusion/sight.hpp"
#include "fusion/track.hpp"

#include <vector>

namespace stillmap::mapping {

/// Whether a track went somewhere, against how far its boxes scatter: a parked car whose box jumps
/// between its corners did not.
[[nodiscard]] bool has_moved(const Track& track);

/// Tracks of one drive that stood at the same place, joined: what was lost and found again.
/// @param tracks  none of them moved. @return in the order of their first box.
[[nodiscard]] std::vector<Track> joined_by_place(std::vector<Track> tracks);

/// What speaks for an object and against it.
struct Evidence {
  /// Scans with a box, and the sum of the log odds of their scores.
  std::size_t hits = 0;
  double score_log_odds = 0.0;
  /// Scans that saw enough points there and had no box.
  std::size_t missed = 0;
  /// Scans between the first and the last box that saw the place free.
  std::size_t seen_free = 0;
  /// Free at another time: what can go away is no part of the street.
  bool free_elsewhen = false;
};
/// A score as evidence; certainty is not believed either way.
[[nodiscard]] double log_odds_of(double score);
/// In [0, 1].
[[nodiscard]] double existence_of(const Evidence& evidence);

/// An object that stood still during a drive.
struct StandingObject {
  maps::Box box;
  Evidence evidence;
  /// Scans in which it was there and may have points, in order, with whether it was detected.
  std::vector<std::pair<std::size_t, bool>> scans;
};
[[nodiscard]] StandingObject standing_object(const Track& track, const SightLines& sight);

}  // namespace stillmap::mapping
