#pragma once

#include <mrpt/core/Clock.h>
#include <mrpt/poses/CPose3D.h>

#include <cstdint>
#include <string>
#include <vector>

#include "rawlogs/rawlog_record.hpp"

namespace stillmap::maps::rawlog {

/// What one observation saw, in the sensor's frame.
struct Sweep {
  std::vector<RawlogPoint> points;
  bool has_intensities = false;
  bool has_times = false;
};

/// Writes records to a descriptor.
class RecordOutput {
 public:
  explicit RecordOutput(int descriptor) : descriptor_(descriptor) {}

  void scan(const Sweep& sweep, const std::string& label, mrpt::Clock::time_point stamp,
            const mrpt::poses::CPose3D& T_base_lidar);
  void pose(RawlogPoseSource source, mrpt::Clock::time_point stamp,
            const mrpt::poses::CPose3D& T_odom_base);
  /// A cloud that cannot be used.
  void skip() { ++unusable_; }
  /// @param reason  empty at the end of the rawlog.
  void end(std::uint64_t objects, const std::string& reason);

 private:
  void put(const void* bytes, std::size_t size);

  int descriptor_;
  std::uint64_t unusable_ = 0;
};

}  // namespace stillmap::maps::rawlog
