#pragma once

#include <stillmap/maps/drive.hpp>

#include <filesystem>

#include "drives/layout.hpp"

namespace stillmap::maps {

/// A dump of hdl_graph_slam: folders 000000, 000001, ... of key frames with `cloud.pcd` and `data`.
[[nodiscard]] bool is_hdl_graph_slam(const std::filesystem::path& root);

/// Stamps and poses are those of the key frames' `data`.
[[nodiscard]] Drive::Contents open_hdl_graph_slam(const std::filesystem::path& root,
                                                  const PosesChoice& poses);

/// A dump of GLIM: folders of submaps with `data.txt` and `points_compact.bin` or `points.bin`. It
/// is no drive: a submap is many scans in one.
[[nodiscard]] bool is_glim_dump(const std::filesystem::path& root);

}  // namespace stillmap::maps
