#pragma once

#include <array>
#include <cstddef>

namespace stillmap::server {

/// What one alignment costs depends on how it is searched for, by orders of magnitude.
enum class WorkKind {
  kNearPrior,   ///< around a prior, with the default method
  kEverywhere,  ///< without a prior
  kReference,   ///< any other method
};
inline constexpr std::size_t kWorkKinds = 3;

/// Running mean and mean deviation of how long a worker was busy with one scan, by kind.
///
/// Gains 1/8 and 1/4 of Jacobson, "Congestion Avoidance and Control", SIGCOMM 1988, appendix A: a
/// smooth mean, and a bound (mean + 4 deviations) that follows a server whose cores are shared.
/// Departure: starts at guesses, since nothing is known before the first answer.
class ServiceTimes {
 public:
  /// @param seconds  for one scan, >= 0; anything else is ignored.
  void add(WorkKind kind, double seconds);
  [[nodiscard]] double mean_s(WorkKind kind) const { return times_[index(kind)].mean_s; }
  /// What all but few stay within.
  [[nodiscard]] double bound_s(WorkKind kind) const {
    const Time& time = times_[index(kind)];
    return time.mean_s + 4.0 * time.deviation_s;
  }

 private:
  struct Time {
    double mean_s;
    double deviation_s;
    bool measured = false;
  };
  [[nodiscard]] static std::size_t index(WorkKind kind) { return static_cast<std::size_t>(kind); }

  /// Guesses from the measured figures of localization/measured.md, for machines half as fast.
  std::array<Time, kWorkKinds> times_ = {{{.mean_s = 0.02, .deviation_s = 0.005},
                                          {.mean_s = 0.15, .deviation_s = 0.03},
                                          {.mean_s = 1.0, .deviation_s = 0.5}}};
};

}  // namespace stillmap::server
