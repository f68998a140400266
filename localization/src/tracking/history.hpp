#pragma once

#include "motion.hpp"

#include <stillmap/localization/tracker.hpp>

#include <cstdint>
#include <functional>
#include <map>
#include <optional>

namespace stillmap::localization {

/// The last answers and states of a session, by stamp.
class TrackingHistory {
 public:
  struct Known {
    MotionState state;
    /// Later scans agreed with it.
    bool confirmed = false;
  };
  /// The states around a time; `after` is null behind the last one.
  struct Neighbours {
    const Known* before = nullptr;
    const Known* after = nullptr;
  };

  explicit TrackingHistory(double kept_s) : kept_s_(kept_s) {}

  /// Whether a stamp lies within what is kept behind the newest one.
  [[nodiscard]] bool keeps(std::int64_t stamp_ns) const;
  [[nodiscard]] std::optional<std::int64_t> newest_ns() const { return newest_ns_; }
  /// Null when this stamp has no answer, or no state.
  [[nodiscard]] const TrackedPose* answer_at(std::int64_t stamp_ns) const;
  [[nodiscard]] const Known* state_at(std::int64_t stamp_ns) const;
  /// @return nothing for a time before the first state.
  [[nodiscard]] std::optional<Neighbours> around(std::int64_t stamp_ns) const;

  void add(const TrackedPose& answer);
  void add(const Known& known);
  /// Of an empty one: the newest scan of another, and its state.
  void restore(std::int64_t newest_ns, const std::optional<Known>& newest);
  /// Of an empty one: the states of another, moved to another map. Its answers are of that map, and
  /// are left out.
  void continue_from(const TrackingHistory& other, const std::function<void(PosePdf&)>& move);
  /// The vehicle turned out to be elsewhere: no pose lies between there and here.
  void forget_states() { states_.clear(); }

 private:
  void prune();

  double kept_s_;
  std::optional<std::int64_t> newest_ns_;
  std::map<std::int64_t, TrackedPose> answers_;
  std::map<std::int64_t, Known> states_;
};

}  // namespace stillmap::localization
