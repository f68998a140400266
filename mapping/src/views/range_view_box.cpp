#include "views/range_view.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace stillmap::mapping {
namespace {

/// A return this far outside of the box still belongs to it [m]: range noise and the box's fit.
constexpr double kSkinM = 0.1;

/// Only rays through this middle part of the length and width, and below this part of the height,
/// tell whether the box is empty: a car leaves the corners of its box and what is above its bonnet
/// free.
constexpr double kCoreAcross = 0.6;
constexpr double kCoreUp = 0.8;

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

/// Ranges at which a ray enters and leaves [m]; it misses when enter > leave.
struct Crossing {
  double enter, leave;
  [[nodiscard]] bool hits() const { return enter <= leave; }
};

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
  /// Over the box's bottom.
  [[nodiscard]] double height_at(const Eigen::Vector3d& direction, double range_m) const {
    return half.z() + sensor.z() + range_m * direction.z();
  }

  [[nodiscard]] Crossing whole(const Eigen::Vector3d& direction) const {
    return between(-half, half, direction);
  }
  [[nodiscard]] Crossing core(const Eigen::Vector3d& direction) const {
    const Eigen::Vector3d low(-kCoreAcross * half.x(), -kCoreAcross * half.y(), -half.z());
    const Eigen::Vector3d high(-low.x(), -low.y(), (2.0 * kCoreUp - 1.0) * half.z());
    return between(low, high, direction);
  }

 private:
  [[nodiscard]] Crossing between(const Eigen::Vector3d& low, const Eigen::Vector3d& high,
                                 const Eigen::Vector3d& direction) const {
    Crossing crossing{0.0, std::numeric_limits<double>::infinity()};
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const double inverse = 1.0 / direction[axis];
      const double a = (low[axis] - sensor[axis]) * inverse;
      const double b = (high[axis] - sensor[axis]) * inverse;
      crossing.enter = std::max(crossing.enter, std::min(a, b));
      crossing.leave = std::min(crossing.leave, std::max(a, b));
    }
    return crossing;
  }
};

/// Ranges of a direction's returns [m]: of the nearest that is not ground, infinite without one,
/// and of the farthest.
struct Returns {
  double nearest, farthest;
};

void add(BoxRays& rays, const BoxFrame& box, const Eigen::Vector3d& direction,
         const Returns& returns) {
  const Crossing whole = box.whole(direction);
  if (!whole.hits()) return;
  const double height_in = box.height_at(direction, whole.enter);
  if (std::max(height_in, box.height_at(direction, whole.leave)) < kRayFloorM) return;
  if (returns.nearest >= whole.enter - kSkinM && returns.nearest <= whole.leave + kSkinM) {
    ++rays.inside;
  } else if (!box.core(direction).hits()) {
    return;
  } else if (returns.nearest < whole.enter || returns.farthest < whole.enter) {
    ++rays.before;
  } else if (returns.farthest > whole.leave || height_in >= kRayFloorM) {
    // The latter ended on the ground inside of the box.
    ++rays.through;
  }
}

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
      const Eigen::Vector3d direction(slope.x() * heading.x(), slope.x() * heading.y(), slope.y());
      add(rays, frame, frame.turned(direction),
          {b.nearest == kNone ? std::numeric_limits<double>::infinity()
                              : b.nearest * static_cast<double>(kQuantumM),
           b.farthest * static_cast<double>(kQuantumM)});
    }
  }
  return rays;
}

}  // namespace stillmap::mapping
