#include "views/range_view.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace stillmap::mapping {
namespace {

/// Rays below this height over the box's bottom may pass under a vehicle [m].
constexpr double kFloorM = 0.35;
/// A return this far outside of the box still belongs to it [m]: range noise and the box's fit.
constexpr double kSkinM = 0.1;

/// Unit directions of columns and rows.
struct Directions {
  std::array<Eigen::Vector2d, ViewGrid::kColumns> columns;
  std::array<Eigen::Vector2d, ViewGrid::kRows> rows;  ///< cosine, sine of the elevation
  Directions() {
    for (int i = 0; i < ViewGrid::kColumns; ++i) {
      const double a = ViewGrid::azimuth_of(i);
      columns[static_cast<std::size_t>(i)] = {std::cos(a), std::sin(a)};
    }
    for (int i = 0; i < ViewGrid::kRows; ++i) {
      const double a = ViewGrid::elevation_of(i);
      rows[static_cast<std::size_t>(i)] = {std::cos(a), std::sin(a)};
    }
  }
};

const Directions& directions() {
  static const Directions all;
  return all;
}

/// A box with the sensor at a place of its own frame (x along the heading).
struct BoxFrame {
  Eigen::Vector3d half, sensor;
  double cos_yaw, sin_yaw;

  explicit BoxFrame(const maps::Box& box)
      : half(0.5 * box.size_m), cos_yaw(std::cos(box.yaw_rad)), sin_yaw(std::sin(box.yaw_rad)) {
    sensor = turned(-box.centre);
  }
  [[nodiscard]] Eigen::Vector3d turned(const Eigen::Vector3d& v) const {
    return {cos_yaw * v.x() + sin_yaw * v.y(), cos_yaw * v.y() - sin_yaw * v.x(), v.z()};
  }

  /// Ranges [m] at which a ray from the sensor enters and leaves; enter > leave when it misses.
  [[nodiscard]] std::array<double, 2> crossing(const Eigen::Vector3d& direction) const {
    double enter = 0.0, leave = std::numeric_limits<double>::infinity();
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const double inverse = 1.0 / direction[axis];
      const double a = (-half[axis] - sensor[axis]) * inverse;
      const double b = (half[axis] - sensor[axis]) * inverse;
      enter = std::max(enter, std::min(a, b));
      leave = std::min(leave, std::max(a, b));
    }
    return {enter, leave};
  }
};

/// Columns and rows that hold the box, seen from the origin.
struct Extent {
  int row_begin = ViewGrid::kRows, row_end = 0, column_begin = 0, column_end = 0;
};

Extent extent_of(const maps::Box& box) {
  const double centre_azimuth = std::atan2(box.centre.y(), box.centre.x());
  const double c = std::cos(box.yaw_rad), s = std::sin(box.yaw_rad);
  double left = 0.0, right = 0.0;
  Extent extent;
  double nearest = std::numeric_limits<double>::infinity();
  for (int corner = 0; corner < 4; ++corner) {
    const double x = ((corner & 1) != 0 ? 0.5 : -0.5) * box.size_m.x();
    const double y = ((corner & 2) != 0 ? 0.5 : -0.5) * box.size_m.y();
    const Eigen::Vector2d p = box.centre.head<2>() + Eigen::Vector2d(c * x - s * y, s * x + c * y);
    const double off =
        std::remainder(std::atan2(p.y(), p.x()) - centre_azimuth, 2.0 * std::numbers::pi);
    left = std::max(left, off);
    right = std::min(right, off);
    nearest = std::min(nearest, p.norm());
  }
  // A side may be nearer than its ends: its foot point is at worst half a side from a corner.
  nearest = std::max(0.1, nearest - 0.5 * box.size_m.head<2>().maxCoeff());
  const double farthest = box.centre.head<2>().norm() + box.size_m.head<2>().norm();
  const double bottom = box.centre.z() - 0.5 * box.size_m.z();
  const double top = box.centre.z() + 0.5 * box.size_m.z();
  const double low = std::atan2(bottom, bottom < 0.0 ? nearest : farthest);
  const double high = std::atan2(top, top > 0.0 ? nearest : farthest);
  extent.row_begin = ViewGrid::row_of(static_cast<float>(low));
  extent.row_end = ViewGrid::row_of(static_cast<float>(high)) + 1;
  extent.column_begin = ViewGrid::column_of(static_cast<float>(centre_azimuth + right));
  extent.column_end = ViewGrid::column_of(static_cast<float>(centre_azimuth + left)) + 1;
  return extent;
}

}  // namespace

BoxRays RangeView::count(const maps::Box& box) const {
  BoxRays rays;
  if (!(box.centre.allFinite() && box.size_m.allFinite() && std::isfinite(box.yaw_rad) &&
        box.size_m.minCoeff() > 0.0))
    return rays;
  const BoxFrame frame(box);
  // From inside of the box every direction leaves it, and none tells whether it is there.
  if ((frame.sensor.cwiseAbs() - frame.half).maxCoeff() <= 0.0) return rays;
  const Extent extent = extent_of(box);
  const Directions& all = directions();
  const int row_end = std::min(extent.row_end, end_row());
  for (int row = std::max(extent.row_begin, first_row_); row < row_end; ++row) {
    const Eigen::Vector2d& slope = all.rows[static_cast<std::size_t>(row)];
    for (int column = extent.column_begin; column < extent.column_end; ++column) {
      const Bin& b = bin(row, column);
      if (b.farthest == 0) continue;
      const Eigen::Vector2d& heading =
          all.columns[static_cast<std::size_t>(ViewGrid::wrapped(column))];
      const Eigen::Vector3d direction =
          frame.turned({slope.x() * heading.x(), slope.x() * heading.y(), slope.y()});
      const auto [enter, leave] = frame.crossing(direction);
      if (!(enter <= leave)) continue;
      const double floor = -frame.half.z() + kFloorM;
      const double height_in = frame.sensor.z() + enter * direction.z();
      if (std::max(height_in, frame.sensor.z() + leave * direction.z()) < floor) continue;
      const double near = b.nearest == kNone ? std::numeric_limits<double>::infinity()
                                             : b.nearest * static_cast<double>(kQuantumM);
      const double far = b.farthest * static_cast<double>(kQuantumM);
      const bool ground = b.nearest == kNone;
      if (near >= enter - kSkinM && near <= leave + kSkinM) {
        ++rays.inside;
      } else if (near < enter || far < enter) {
        ++rays.before;
      } else if (far > leave || (ground && height_in >= floor)) {
        ++rays.through;
      }
    }
  }
  return rays;
}

}  // namespace stillmap::mapping
