#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

namespace stillmap::server {

/// How far a vehicle's clock seems to be off.
///
/// A stamp before 2000 is no epoch time but a clock of its own (time since the vehicle was
/// started), of which nothing can be said.
/// @param allowed  also covers how long the scan was on its way. @return ahead of the server's
/// clock [s]; none when it is a relative clock or within what is allowed.
[[nodiscard]] inline std::optional<double> clock_skew_s(std::int64_t stamp_ns,
                                                        std::chrono::system_clock::time_point now,
                                                        std::chrono::duration<double> allowed) {
  constexpr std::int64_t kYear2000Ns = 946'684'800'000'000'000;
  if (stamp_ns < kYear2000Ns) return std::nullopt;
  const std::int64_t now_ns =
      std::chrono::duration_cast<std::chrono::nanoseconds>(now.time_since_epoch()).count();
  const double ahead_s = 1e-9 * (static_cast<double>(stamp_ns) - static_cast<double>(now_ns));
  if (ahead_s <= allowed.count() && ahead_s >= -allowed.count()) return std::nullopt;
  return ahead_s;
}

}  // namespace stillmap::server
