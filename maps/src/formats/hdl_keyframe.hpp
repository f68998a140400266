#pragma once

#include <stillmap/maps/trajectory.hpp>

#include <filesystem>
#include <vector>

namespace stillmap::maps {

/// Folders of a dump of hdl_graph_slam, with `cloud.pcd` and `data` each, sorted by their numbers.
/// @throws StorageError if `root` cannot be listed.
[[nodiscard]] std::vector<std::filesystem::path> hdl_keyframe_folders(
    const std::filesystem::path& root);

/// A key frame with its folder.
struct HdlKeyframe {
  StampedPose pose;
  std::filesystem::path folder;
};
/// Those of a dump, sorted by their stamps: the numbers of the folders are those of the graph,
/// which need not follow time. Of equal stamps in the order of the numbers.
/// @throws as below.
[[nodiscard]] std::vector<HdlKeyframe> read_hdl_keyframes(const std::filesystem::path& root);

/// Stamp and estimate of a key frame's file `data`, as `KeyFrame::save` writes it: `stamp` with
/// seconds and nanoseconds, `estimate` with a 4x4 matrix behind it.
/// Source: https://github.com/koide3/hdl_graph_slam, src/hdl_graph_slam/keyframe.cpp.
/// @throws InputError naming file and what is missing; StorageError.
[[nodiscard]] StampedPose read_hdl_keyframe(const std::filesystem::path& file);

}  // namespace stillmap::maps
