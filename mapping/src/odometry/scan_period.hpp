#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace stillmap::mapping {

/// Time from scan to scan, as far as motions may be told by it. Stamps of arrival come in bursts: a
/// sensor that has moved by half a metre since a stamp of a millisecond ago is not that fast, and
/// what is predicted by such a speed is lost. Clocks jump, too.
class ScanPeriod {
 public:
  /// A longer step between stamps is a jump of the clock or a gap that no speed reaches over [s].
  static constexpr double kMaxGapS = 3.0;

  struct Step {
    /// Since the scan before, at least half of the usual period, > 0 [s].
    double seconds = 0.0;
    /// Longer than `kMaxGapS`: the way meanwhile may be that of any time.
    bool is_gap = false;
  };
  /// From the scan before to the next one; none for the first.
  /// @param source  of the scan, for the message.
  /// @throws std::invalid_argument naming a stamp that does not increase.
  [[nodiscard]] std::optional<Step> step_to(std::int64_t stamp_ns, const std::string& source);
  /// What scans are usually apart [s].
  [[nodiscard]] double usual_s() const { return usual_s_; }

 private:
  std::optional<std::int64_t> last_ns_;
  double usual_s_ = 0.1;
};

}  // namespace stillmap::mapping
