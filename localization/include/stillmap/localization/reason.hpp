#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::localization {

/// Why an answer is not `ok`. The last seven come from a session alone (`Tracker`).
enum class Reason : std::uint8_t {
  kTooFewPoints,           ///< the thinned scan has too few points to be matched
  kOutsideMap,             ///< the prior lies more than 100 m outside the map's bounds
  kNeedsPrior,             ///< this method or this map cannot be searched without a prior
  kTooLittleStructure,     ///< too few points stand above the ground
  kLittleOverlap,          ///< the map knows too little of what the scan sees
  kLowInlierRatio,         ///< too few standing points lie on the map's surfaces
  kUnobservableDirection,  ///< the scan fits as well after a shift along some direction
  kAmbiguous,              ///< a second place fits about as well
  kContradictsPrior,       ///< the prior's covariance excludes the pose
  kNotDeskewed,            ///< the sensor moved during the scan, and no point times were used
  kLargeCovariance,        ///< the pose is too uncertain
  kNotConverged,           ///< a reference method still moved the pose when it stopped
  kCoasting,               ///< no match agrees: pose and covariance are predicted
  kInterpolated,           ///< a late scan: the same, between its neighbours
  kContradictsMotion,      ///< the motion of the vehicle excludes the match
  kUnconfirmed,            ///< found by a search: no later scan has agreed yet
  kNotTracked,             ///< nothing predicts the pose any more
  kTooOld,                 ///< the scan is older than what the session keeps
  kClockSetBack,           ///< the timestamps jumped back: the session started anew
};
/// The word of the API, such as `too_few_points`.
[[nodiscard]] std::string_view name_of(Reason reason);
[[nodiscard]] std::vector<std::string> names_of(const std::vector<Reason>& reasons);
/// In the order of the enumeration.
[[nodiscard]] std::span<const Reason> all_reasons();

}  // namespace stillmap::localization
