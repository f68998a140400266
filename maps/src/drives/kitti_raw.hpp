#pragma once

#include <stillmap/maps/drive.hpp>

#include "drives/layout.hpp"

#include <filesystem>

namespace stillmap::maps {

[[nodiscard]] bool is_kitti_raw(const std::filesystem::path& root);

/// KITTI raw, synced: `velodyne_points/data/*.bin` with `timestamps{,_start,_end}.txt`,
/// `oxts/data/*.txt` with `timestamps.txt`, and `calib_imu_to_velo.txt` in the date folder above.
/// The number in a file's name is its line in the stamps (from 0).
///
/// The map frame is east-north-up with its origin at the first oxts position (recorded as
/// `origin`). Stamps carry no zone; they are taken as UTC. Sweeps are as recorded, so
/// `spin_start_end_s` is filled.
/// @param choice      its file, if any, replaces oxts, which then need not be there, nor the
///                    calibration.
[[nodiscard]] Drive::Contents open_kitti_raw(const std::filesystem::path& root,
                                             const PosesChoice& choice);

}  // namespace stillmap::maps
