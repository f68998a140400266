#pragma once

#include <stillmap/maps/drive.hpp>

#include "drives/layout.hpp"

#include <filesystem>

namespace stillmap::maps {

[[nodiscard]] bool is_keyframes(const std::filesystem::path& root);

/// Key frames of a SLAM run: `Scans/*.pcd` (or `scans/`) with `optimized_poses.txt` (else
/// `odom_poses.txt`), 12 numbers a line, and `times.txt` in seconds. Points are taken as deskewed
/// by whoever chose the key frames.
/// @param choice      its file, if any, replaces the folder's own poses.
[[nodiscard]] Drive::Contents open_keyframes(const std::filesystem::path& root,
                                             const PosesChoice& choice);

}  // namespace stillmap::maps
