#pragma once

#include <mrpt/core/Clock.h>

#include <cstdint>

#include "rawlogs/rawlog_record.hpp"

namespace stillmap::maps::rawlog {

/// MRPT counts 100 ns from 1601-01-01; 0 stands for no time.
inline constexpr std::int64_t kEpochTicks = 116'444'736'000'000'000;
inline constexpr std::int64_t kNsPerTick = 100;

[[nodiscard]] inline std::int64_t stamp_ns_of(mrpt::Clock::time_point time) {
  const std::int64_t ticks = time.time_since_epoch().count();
  std::int64_t stamp_ns = 0;
  if (ticks == 0 || __builtin_sub_overflow(ticks, kEpochTicks, &stamp_ns) ||
      __builtin_mul_overflow(stamp_ns, kNsPerTick, &stamp_ns))
    return kNoRawlogStamp;
  return stamp_ns;
}

/// To 100 ns.
[[nodiscard]] inline mrpt::Clock::time_point time_of(std::int64_t stamp_ns) {
  return mrpt::Clock::time_point(mrpt::Clock::duration(stamp_ns / kNsPerTick + kEpochTicks));
}

}  // namespace stillmap::maps::rawlog
