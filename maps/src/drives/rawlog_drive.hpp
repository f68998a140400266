#pragma once

#include <stillmap/maps/drive.hpp>

#include "drives/layout.hpp"

#include <filesystem>
#include <string_view>

namespace stillmap::maps {

/// A file, mostly packed by gzip, that begins with an object of MRPT's that rawlogs are made of; or
/// a folder with `*.rawlog`.
[[nodiscard]] bool is_rawlog(const std::filesystem::path& root);

/// An MRPT rawlog: its CObservationPointCloud, CObservation3DRangeScan (with points or a range
/// image) and CObservationVelodyneScan (points or packets) of one sensor label, in the sensor's
/// frame, plain or in sensory frames.
///
/// Poses, the first of these that are there: CObservationRobotPose, CObservationOdometry, the
/// movements of CActionCollection; with the sensor's place on the robot, interpolated to the scans.
/// Scans at the ends without one are left out. A rawlog that ends too early, or holds what MRPT
/// cannot read, gives what stands before that, and says so.
///
/// MRPT reads it in a process of its own (`stillmap-rawlog`), once for each process that opens it;
/// the scans wait in a file without a name among the temporary ones.
/// @param root   the file, or a folder with one.
/// @param words  `cloud=LABEL` where there are several, `poses=none|robot_pose|odometry|actions`;
/// in a folder also from its `topics.txt`.
/// @throws InputError, StorageError.
[[nodiscard]] Drive::Contents open_rawlog_drive(const std::filesystem::path& root,
                                                std::string_view words, const PosesChoice& poses);

}  // namespace stillmap::maps
