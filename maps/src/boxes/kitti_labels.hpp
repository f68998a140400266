#pragma once

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/labelled_boxes.hpp>

#include <cstddef>
#include <filesystem>
#include <map>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// Longest side of a box [m], longer than any tram: what claims more is a broken file, and the work
/// on the ground below a box grows with its area.
inline constexpr double kMaxBoxSizeM = 200.0;
/// Farthest centre on each axis [m]: more is no number of a frame around a sensor, and overflows
/// float arithmetic and tables of cells.
inline constexpr double kMaxBoxDistanceM = 1e6;

struct KittiLabels {
  BoxSequence boxes;
  /// By scan; also counted in `boxes.dropped`.
  std::map<std::size_t, std::vector<ImageRectangle>> dont_care;
};

/// KITTI tracking labels as `read_boxes` describes them.
[[nodiscard]] KittiLabels parse_kitti_labels(const std::filesystem::path& file,
                                             std::string_view text, std::size_t scan_count);

/// KITTI object labels: the same of one scan, without the first two fields (frame and track).
[[nodiscard]] KittiLabels parse_kitti_object_labels(const std::filesystem::path& file,
                                                    std::string_view text, std::size_t scan);

}  // namespace stillmap::maps
