#pragma once

#include <string>
#include <string_view>

#include "detection/voxelnext/weights.hpp"

namespace stillmap::mapping {

/// Bounds of a network that is run here: generous to the largest published one (256 channels), and
/// a wall before sizes that only a broken or hostile file asks for.
inline constexpr int kMaxVoxelNextChannels = 1024;
inline constexpr int kMaxVoxelNextBlocks = 16;
inline constexpr int kMaxVoxelNextHeads = 64;
inline constexpr int kMaxVoxelNextClasses = 64;
/// Cells along an axis, and of the whole grid, as SiteSet has a bit for each. The published
/// networks for nuScenes, Waymo and KITTI need a fifth of it or less; that for Argoverse 2 (400 m
/// wide) needs 3.2e9 and must be converted with a smaller range.
inline constexpr int kMaxVoxelNextCells = 16384;
inline constexpr double kMaxVoxelNextGrid = 0x1p29;

/// Reads the `config` of a weights file: every key is there, none is unknown, every number is
/// within its bounds, lists have the length that the heads ask for.
/// @param name  the file, for messages.
/// @throws maps::InputError "NAME at config.KEY: found ..., expected ...".
[[nodiscard]] VoxelNextConfig parse_voxelnext_config(std::string_view text,
                                                     const std::string& name);

}  // namespace stillmap::mapping
