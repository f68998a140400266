#pragma once

#include <stillmap/maps/box.hpp>

#include <filesystem>
#include <string_view>

namespace stillmap::maps {

/// KITTI tracking labels as `read_boxes` describes them.
[[nodiscard]] BoxSequence parse_kitti_labels(const std::filesystem::path& file,
                                             std::string_view text, std::size_t scan_count);

}  // namespace stillmap::maps
