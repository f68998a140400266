#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// What was asked of each map since the server began, in memory. Safe from several threads.
class MapStats {
 public:
  using Clock = std::chrono::system_clock;

  struct Percentiles {
    double p50_ms = 0.0;
    double p95_ms = 0.0;
  };
  struct Figures {
    /// Poses by status.
    std::uint64_t ok = 0;
    std::uint64_t degraded = 0;
    std::uint64_t lost = 0;
    /// Queries answered with a problem.
    std::uint64_t refused = 0;
    /// When the last pose was answered.
    std::optional<Clock::time_point> last{};
    /// Of the newest `timed` poses; nothing when there is none.
    std::size_t timed = 0;
    std::optional<Percentiles> localizer{};
    std::optional<Percentiles> total{};
  };

  /// @param status  `ok`, `degraded` or `lost`.
  void answered(const std::string& map, std::string_view status, double localizer_ms,
                double total_ms, Clock::time_point now = Clock::now());
  /// @param map  one that there is.
  void refused(const std::string& map);
  /// The map was removed: a new one of that name begins anew.
  void forget(const std::string& map);
  [[nodiscard]] Figures figures(const std::string& map) const;

 private:
  /// Enough for a 95th percentile that stands still, recent enough to show what changed.
  static constexpr std::size_t kTimed = 1024;
  struct Entry {
    Figures figures;
    std::uint64_t count = 0;
    std::array<float, kTimed> localizer_ms{};
    std::array<float, kTimed> total_ms{};
  };
  mutable std::mutex mutex_;
  std::map<std::string, Entry> entries_;
};

}  // namespace stillmap::server
