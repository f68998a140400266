#include <stillmap/localization/movable.hpp>

#include "index/voxel_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace stillmap::localization {
namespace {

/// Boxes are found by columns of this edge, so that a scan costs one look-up a point however many
/// boxes there are.
constexpr double kMovableColumnM = 4.0;
/// No box reaches farther along an axis [m].
constexpr double kMovableReachM = 2.0 * kMaxBoxCentreM;
constexpr double kMaxMarginM = 10.0;

void require_usable(const maps::Box& box, std::size_t number) {
  const auto refuse = [&](const char* name, double found, const std::string& expected) {
    throw std::invalid_argument(
        fmt::format("box {}: found {} {}, expected {}", number, name, found, expected));
  };
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    if (!(std::abs(box.centre[axis]) <= kMaxBoxCentreM)) {
      refuse("centre", box.centre[axis], fmt::format("within {} m", kMaxBoxCentreM));
    }
    if (!(box.size_m[axis] > 0.0 && box.size_m[axis] <= kMaxBoxEdgeM)) {
      refuse("size", box.size_m[axis], fmt::format("above 0 and up to {} m", kMaxBoxEdgeM));
    }
  }
  if (!std::isfinite(box.yaw_rad)) refuse("yaw", box.yaw_rad, "a finite number");
}

/// A grown box with its heading worked out once.
struct GrownBox {
  Eigen::Vector3d centre, half;
  double cosine, sine;

  GrownBox(const maps::Box& box, double margin_m)
      : centre(box.centre),
        half((0.5 * box.size_m).array() + margin_m),
        cosine(std::cos(box.yaw_rad)),
        sine(std::sin(box.yaw_rad)) {}

  [[nodiscard]] bool contains(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d d = p - centre;
    return std::abs(cosine * d.x() + sine * d.y()) <= half.x() &&
           std::abs(cosine * d.y() - sine * d.x()) <= half.y() && std::abs(d.z()) <= half.z();
  }
  /// Half the sides of the upright, axis-parallel rectangle around it.
  [[nodiscard]] Eigen::Vector2d reach() const {
    return {std::abs(cosine) * half.x() + std::abs(sine) * half.y(),
            std::abs(sine) * half.x() + std::abs(cosine) * half.y()};
  }
};

class BoxesByColumn {
 public:
  BoxesByColumn(std::span<const maps::Box> boxes, double margin_m) {
    for (const maps::Box& box : boxes) {
      const GrownBox& grown = boxes_.emplace_back(box, margin_m);
      const Eigen::Vector2d reach = grown.reach();
      for (std::int32_t x = cell(grown.centre.x() - reach.x());
           x <= cell(grown.centre.x() + reach.x()); ++x) {
        for (std::int32_t y = cell(grown.centre.y() - reach.y());
             y <= cell(grown.centre.y() + reach.y()); ++y) {
          const auto [column, inserted] = columns_.insert(cell_key(x, y, 0));
          if (inserted) boxes_of_.emplace_back();
          boxes_of_[column].push_back(boxes_.size() - 1);
        }
      }
    }
  }

  [[nodiscard]] bool contain(const Eigen::Vector3d& p) const {
    // Beyond it a cast would overflow; false for NaN.
    if (!(std::abs(p.x()) < kMovableReachM && std::abs(p.y()) < kMovableReachM)) return false;
    const std::uint32_t column = columns_.find(cell_key(cell(p.x()), cell(p.y()), 0));
    if (column == VoxelTable::kNone) return false;
    return std::any_of(boxes_of_[column].begin(), boxes_of_[column].end(),
                       [&](std::size_t box) { return boxes_[box].contains(p); });
  }

 private:
  [[nodiscard]] static std::int32_t cell(double coordinate_m) {
    return static_cast<std::int32_t>(std::floor(coordinate_m / kMovableColumnM)) +
           kCellsPerAxis / 2;
  }

  std::vector<GrownBox> boxes_;
  VoxelTable columns_;
  std::vector<std::vector<std::size_t>> boxes_of_;
};

}  // namespace

maps::PointCloud without_points_in(const maps::PointCloud& scan_lidar,
                                   std::span<const maps::Box> boxes_lidar, double margin_m) {
  for (std::size_t i = 0; i < boxes_lidar.size(); ++i) require_usable(boxes_lidar[i], i);
  if (!(margin_m >= 0.0 && margin_m <= kMaxMarginM)) {
    throw std::invalid_argument(
        fmt::format("margin_m: found {}, expected 0 to {}", margin_m, kMaxMarginM));
  }
  const BoxesByColumn boxes(boxes_lidar, margin_m);
  maps::PointCloud kept;
  kept.positions.reserve(scan_lidar.size());
  for (std::size_t i = 0; i < scan_lidar.size(); ++i) {
    if (boxes.contain(scan_lidar.positions[i].cast<double>())) continue;
    kept.positions.push_back(scan_lidar.positions[i]);
    if (!scan_lidar.intensities.empty()) kept.intensities.push_back(scan_lidar.intensities[i]);
    if (!scan_lidar.time_offsets_s.empty()) {
      kept.time_offsets_s.push_back(scan_lidar.time_offsets_s[i]);
    }
  }
  return kept;
}

}  // namespace stillmap::localization
