#pragma once

#include <stillmap/maps/drive.hpp>

#include "drives/layout.hpp"

#include <filesystem>

namespace stillmap::maps {

/// Scans in the folder itself, or in folders of it.
[[nodiscard]] bool is_scan_folder(const std::filesystem::path& root);

/// `*.pcd`, `*.ply` or `*.bin`, one kind, in the folder itself or in one folder of it, in natural
/// order of names. Poses (`T_map_lidar`) from `poses.txt` or a `*.tum` in the folder, KITTI or TUM
/// by their numbers a line.
///
/// Stamps: from the names if all are of 19 digits (ns since the epoch), 16 (us) or 10 with decimals
/// (s); else from a TUM file with as many lines as there are scans, in order; else 0.1 s apart.
/// @param choice      its file, if any, replaces the folder's own poses.
[[nodiscard]] Drive::Contents open_scan_folder(const std::filesystem::path& root,
                                               const PosesChoice& choice);

}  // namespace stillmap::maps
