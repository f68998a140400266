#pragma once

#include "history.hpp"
#include "motion.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::localization {

/// How the next scan is looked for.
enum class TrackingMode : std::uint8_t {
  kTracking,    ///< around the prediction
  kWide,        ///< widely around it
  kEverywhere,  ///< without a prior
};

/// What a session believes after a scan.
struct TrackingBelief {
  TrackingMode mode = TrackingMode::kEverywhere;
  /// The last pose that a match or odometry told; none before the vehicle was found.
  std::optional<MotionState> anchor;
  std::int64_t matched_ns = 0;
  /// Any scan was found at all.
  bool matched = false;
  /// Answers that agree on where the vehicle is; at `agreeing_answers` it is tracked.
  int agreed = 0;
  /// In a row: matches against the motion, scans that were looked for in vain.
  int contradictions = 0;
  int misses = 0;
};

/// All that the answers to newer scans depend on.
struct TrackingState {
  std::int64_t newest_ns = 0;
  TrackingBelief belief;
  /// Of the newest scan, which odometry may start from; none when it told no place.
  std::optional<TrackingHistory::Known> newest;
};

/// The format is in localization/sessions.md; at most `kMaxTrackerStateBytes`.
[[nodiscard]] std::string encode_state(const TrackingState& state);
/// @throws maps::InputError for bytes that `encode_state` does not write.
[[nodiscard]] TrackingState decode_state(std::string_view bytes);

}  // namespace stillmap::localization
