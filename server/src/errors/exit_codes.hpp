#pragma once

/// Exit codes of the programs. The server reads those of the mapper, which does its jobs.
namespace stillmap::exit_code {

inline constexpr int kSucceeded = 0;
inline constexpr int kFailed = 1;
inline constexpr int kUsage = 2;
/// Failed for want of room on the disk: with more of it, the same may do well.
inline constexpr int kDiskFull = 3;
/// `rebuild` made its map, and the map did not pass the gate.
inline constexpr int kGateNotPassed = 4;
inline constexpr int kCancelled = 130;

}  // namespace stillmap::exit_code
