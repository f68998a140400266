#pragma once

#include "fusion/place_look.hpp"

#include <cstddef>

namespace stillmap::mapping {

/// What speaks for an object and against it.
struct Evidence {
  /// Scans with a box.
  std::size_t hits = 0;
  /// Scans that saw enough of the place and had no box.
  std::size_t missed = 0;
  /// Sum of what each scan says.
  double log_odds = 0.0;
  /// Free at another time: what can go away is no part of the street.
  bool free_elsewhen = false;

  /// @param weight  share of the scan's opinion that is new, in [0, 1].
  void add_hit(double weight, double log_odds_of_box);
  /// A scan without a box in the time when there should be one: rays through the place speak
  /// strongly against it, many on it a little, since detectors miss things.
  void add_silence(double weight, const PlaceLook& look);
};

/// A score as evidence; certainty is not believed either way.
[[nodiscard]] double log_odds_of(double score);
/// Share of a scan's opinion that is new after the sensor went so far [m]; in (0, 1].
[[nodiscard]] double view_weight(double travel_m);
/// In [0, 1].
[[nodiscard]] double existence_of(const Evidence& evidence);

}  // namespace stillmap::mapping
