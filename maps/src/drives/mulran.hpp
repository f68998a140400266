#pragma once

#include <stillmap/maps/drive.hpp>

#include "drives/layout.hpp"

#include <filesystem>

namespace stillmap::maps {

[[nodiscard]] bool is_mulran(const std::filesystem::path& root);

/// A sequence of MulRan as it is downloaded, or ordered as its file player wants it: `Ouster/*.bin`
/// or `sensor_data/Ouster/*.bin` (float32 x y z intensity, named by ns since the epoch), with
/// `global_pose.csv` (ns and 12 numbers, 3x4 row-major, of the vehicle in UTM) and
/// `ouster_front_stamp.csv` (a line for each scan), of which either may be missing.
///
/// The map frame is east-north-up with its origin at the first scan's vehicle (recorded as
/// `origin`); poses are turned by the zone's convergence, and stretched by its scale, into it.
/// Poses that lie elsewhere than MulRan's country are taken as local ones, as they are. Poses have
/// other stamps than scans and are interpolated; scans at the ends without one are left out.
///
/// Sources: Kim et al., "MulRan: Multimodal Range Dataset for Urban Place Recognition", ICRA 2020;
/// its file player (RPM-Robotics-Lab/file_player_mulran), whose rings are a point's number modulo
/// 64; the extrinsics of its calibration page. Which instant of the sweep is its stamp stands
/// nowhere: the middle is taken, as by MOLA's reader, at most half a turn off.
/// @param choice      its file, if any, replaces the sequence's own poses.
[[nodiscard]] Drive::Contents open_mulran(const std::filesystem::path& root,
                                          const PosesChoice& choice);

}  // namespace stillmap::maps
