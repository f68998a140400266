#pragma once

#include <stillmap/maps/box.hpp>

#include <filesystem>
#include <string_view>

namespace stillmap::maps {

/// Longest side of a box [m], longer than any tram: what claims more is a broken file, and the work
/// on the ground below a box grows with its area.
inline constexpr double kMaxBoxSizeM = 200.0;
/// Farthest centre on each axis [m]: more is no number of a frame around a sensor, and overflows
/// float arithmetic and tables of cells.
inline constexpr double kMaxBoxDistanceM = 1e6;

/// KITTI tracking labels as `read_boxes` describes them.
[[nodiscard]] BoxSequence parse_kitti_labels(const std::filesystem::path& file,
                                             std::string_view text, std::size_t scan_count);

}  // namespace stillmap::maps
