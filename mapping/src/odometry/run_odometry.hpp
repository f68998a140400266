#pragma once

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>

#include <cstddef>
#include <functional>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Reads a scan of the drive; called from several threads at once.
using ReadScan = std::function<maps::Scan(std::size_t index)>;
/// Is handed each scan as it was read, in order, once it is placed. Hidden scans are moved again at
/// the end: their poses are those that are returned.
using TakePlacedScan =
    std::function<void(std::size_t index, const maps::Scan& scan, const OdometryPose& pose)>;

/// A drive to follow through its scans [begin, end).
struct FollowedDrive {
  const maps::Drive& drive;
  std::size_t begin = 0;
  /// Past the last scan, at most the drive's size.
  std::size_t end = 0;
  /// One of `odometry_names()`.
  std::string_view method = "default";
  /// Each scan is looked for where the drive's given poses say that it was taken.
  bool expects_given_poses = false;
  /// Instead of `drive.read`, e.g. with projected points; must keep the stamps.
  ReadScan read{};
  /// May be empty.
  TakePlacedScan take{};
};

/// Reads and prepares several scans at once.
/// @param threads   0 = all cores; the poses are the same bits for any number.
/// @param progress  may be empty; stage "odometry".
/// @return one pose a scan, those of [begin, end).
/// @throws std::invalid_argument for a range outside the drive or an unknown method, Cancelled, and
/// what reading, the method and `take` throw.
[[nodiscard]] std::vector<OdometryPose> run_odometry(const FollowedDrive& followed, int threads,
                                                     const ProgressCallback& progress,
                                                     const CancelFlag& cancel);

}  // namespace stillmap::mapping
