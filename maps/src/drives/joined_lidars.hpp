#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/lidar_set.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "drives/layout.hpp"

namespace stillmap::maps {

/// A lidar beside the reference.
struct BesideLidar {
  Drive drive;
  /// For notes, and for the names of scans.
  std::string name;
  Eigen::Isometry3d T_reference_lidar = Eigen::Isometry3d::Identity();
  /// Added to its stamps to get those of the reference's clock.
  std::int64_t offset_ns = 0;
};

/// The drive of the reference whose scans hold the points of all lidars, in the reference's frame,
/// with times relative to the reference's stamps. Each sweep of another lidar joins the scan that
/// is nearest in time, within half of the reference's period; sweeps and scans that are left alone
/// are counted in the notes.
/// Labels do not fit any more and are left out.
/// @param name  of the reference.
/// @throws InputError where no sweep of a lidar joins a scan.
[[nodiscard]] Drive::Contents joined_lidars(const Drive& reference, const std::string& name,
                                            std::vector<BesideLidar> others);

/// Whether a folder is a drive of several lidars (`lidar_set.hpp`).
[[nodiscard]] bool is_lidar_set(const std::filesystem::path& root);
/// @param poses  of the reference.
/// @throws InputError for a choice of the points' frame, which is made behind each drive, or a
/// drive that leaves a choice; else as `read_lidar_set`, `Drive::open` and `joined_lidars`.
[[nodiscard]] Drive::Contents open_lidar_set(const std::filesystem::path& root,
                                             const PosesChoice& poses);

}  // namespace stillmap::maps
