#pragma once

#include "fusion/sight.hpp"
#include "fusion/track.hpp"

#include <vector>

namespace stillmap::mapping {

/// Whether a track went somewhere: farther than the box of a parked car jumps between its corners,
/// and the places it left, or had not reached yet, were seen free. Given tracks are believed.
[[nodiscard]] bool has_moved(const Track& track, const SightLines& sight);

/// Tracks of one drive that stood at the same place, joined: what was lost and found again.
/// @param tracks  none of them moved. @return in the order of their first box.
[[nodiscard]] std::vector<Track> joined_by_place(std::vector<Track> tracks);

/// Points that a detector can make a box of; a scan that saw fewer says nothing by finding none.
inline constexpr std::size_t kMinPointsToMiss = 40;
/// A good view without a box: detectors find nine of ten cars that are near and in plain sight.
inline constexpr double kMissLogOdds = -2.0;
/// Rays went right through it.
inline constexpr double kFreeLogOdds = -1.0;

/// What speaks for an object and against it.
struct Evidence {
  /// Scans with a box.
  std::size_t hits = 0;
  /// Scans that saw enough points there and had no box.
  std::size_t missed = 0;
  /// Sum of what each scan says; scans taken from one place count as one.
  double log_odds = 0.0;
  /// Free at another time: what can go away is no part of the street.
  bool free_elsewhen = false;
};
/// Share of a scan's opinion that is new, after the sensor went so far [m]; in (0, 1].
[[nodiscard]] double view_weight(double travel_m);
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
