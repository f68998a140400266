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
/// Is handed each scan as it was read, in order, once it is placed.
using TakePlacedScan =
    std::function<void(std::size_t index, const maps::Scan& scan, const OdometryPose& pose)>;

/// Follows a drive through its scans [begin, end), reading and preparing several at once.
/// @param end       past the last scan, at most the drive's size.
/// @param method    one of `odometry_names()`.
/// @param threads   0 = all cores; the poses are the same bits for any number.
/// @param progress  may be empty; stage "odometry".
/// @param read      instead of `drive.read`, e.g. with projected points; must keep the stamps.
/// @param take      may be empty.
/// @return one pose a scan, those of [begin, end).
/// @throws std::invalid_argument for a range outside the drive or an unknown method, Cancelled, and
/// what reading, the method and `take` throw.
[[nodiscard]] std::vector<OdometryPose> run_odometry(const maps::Drive& drive, std::size_t begin,
                                                     std::size_t end, std::string_view method,
                                                     int threads, const ProgressCallback& progress,
                                                     const CancelFlag& cancel,
                                                     const ReadScan& read = {},
                                                     const TakePlacedScan& take = {});

}  // namespace stillmap::mapping
