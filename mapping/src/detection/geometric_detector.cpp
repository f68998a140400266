#include "detection/geometric_detector.hpp"

#include "detection/column_grid.hpp"
#include "detection/rectangle_fit.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace stillmap::mapping {
namespace {

/// Between the roof of a car and the top of a wall: columns with points here are parts of tall
/// things [m].
constexpr std::array<float, 2> kHeadBandM{2.0F, 2.9F};
/// Outlines are taken from the body, below mirrors and windows that let rays through [m].
constexpr float kBodyTopM = 0.8F;
constexpr std::size_t kMaxFitPoints = 300;
constexpr double kTopMarginM = 0.15;
/// How far below the lowest ground under its points a box begins: its hidden side may stand lower
/// [m].
constexpr double kBottomMarginM = 0.3;
/// Share of an object's columns that may touch something tall.
constexpr double kMaxTouching = 0.25;

/// What an object of one class measures.
struct ShapeRule {
  maps::ObjectClass object_class;
  /// Usual size, used for what is hidden [m].
  double length_m, width_m;
  /// What is accepted of the seen part, by longer and shorter side, and of its top and lowest point
  /// [m].
  std::array<double, 2> longer_m, shorter_m;
  std::array<double, 2> top_m;
  double lowest_m;
  double outline_share;
  std::size_t points;
};

constexpr std::array<ShapeRule, 3> kLowRules{{
    {maps::ObjectClass::kCar, 4.3, 1.8, {2.6, 5.4}, {0.25, 2.3}, {1.15, 2.0}, 0.65, 0.5, 40},
    // A rear or a front alone: as wide as a car and flat.
    {maps::ObjectClass::kCar, 4.3, 1.8, {1.35, 2.6}, {0.1, 2.1}, {1.15, 1.9}, 0.65, 0.62, 30},
    {maps::ObjectClass::kPedestrian, 0.7, 0.7, {0.3, 1.1}, {0.15, 0.9}, {1.4, 2.0}, 0.6, 0.0, 15},
}};
constexpr ShapeRule kVanRule{
    maps::ObjectClass::kVan, 5.2, 2.0, {3.5, 12.0}, {1.3, 2.9}, {1.9, 4.0}, 0.7, 0.7, 100};

using Columns = std::vector<std::uint8_t>;

/// A cluster with what the rules look at.
struct ClusterShape {
  std::vector<RaisedPoint> points;
  Rectangle rectangle;
  /// Where the lidars stand that took the points, on the mean [m].
  Eigen::Vector2d lidar = Eigen::Vector2d::Zero();
  double top_m = 0.0;
  double lowest_m = std::numeric_limits<double>::max();
  /// Share of the cluster's columns that touch a tall column.
  double touching_tall = 0.0;
};

struct Scene {
  ColumnGrid grid;
  Columns low;   ///< columns with points, none at head height
  Columns tall;  ///< columns with points at head height
  Columns any;   ///< columns with points up to the top of a truck
};

Scene scene_of(const maps::PointCloud& cloud, const GroundResult& ground) {
  constexpr std::size_t kColumnCount = std::size_t{ColumnGrid::kSide} * ColumnGrid::kSide;
  Scene scene{ColumnGrid(cloud, ground), Columns(kColumnCount), Columns(kColumnCount),
              Columns(kColumnCount)};
  for (std::size_t c = 0; c < kColumnCount; ++c) {
    bool low = false, tall = false;
    const int column = static_cast<int>(c);
    for (std::uint32_t i = scene.grid.first(column); i < scene.grid.first(column + 1); ++i) {
      const float height_m = scene.grid.points()[i].height_m;
      low = low || height_m < kHeadBandM[0];
      tall = tall || (height_m >= kHeadBandM[0] && height_m < kHeadBandM[1]);
    }
    scene.tall[c] = tall ? 1 : 0;
    scene.low[c] = low && !tall ? 1 : 0;
    scene.any[c] = low || tall ? 1 : 0;
  }
  return scene;
}

bool has_tall_neighbour(const Scene& scene, int column) {
  const int x = column % ColumnGrid::kSide, y = column / ColumnGrid::kSide;
  for (int ny = std::max(0, y - 1); ny <= std::min(ColumnGrid::kSide - 1, y + 1); ++ny) {
    for (int nx = std::max(0, x - 1); nx <= std::min(ColumnGrid::kSide - 1, x + 1); ++nx) {
      if (scene.tall[static_cast<std::size_t>(ny) * ColumnGrid::kSide +
                     static_cast<std::size_t>(nx)] != 0)
        return true;
    }
  }
  return false;
}

/// Points of the body, evenly thinned; all points when the body has too few.
std::vector<Eigen::Vector2d> outline_points(const std::vector<RaisedPoint>& points) {
  std::vector<Eigen::Vector2d> body;
  for (const RaisedPoint& p : points) {
    if (p.height_m < kBodyTopM) body.emplace_back(p.p_lidar.head<2>().cast<double>());
  }
  if (body.size() < 10) {
    body.clear();
    for (const RaisedPoint& p : points) body.emplace_back(p.p_lidar.head<2>().cast<double>());
  }
  if (body.size() <= kMaxFitPoints) return body;
  std::vector<Eigen::Vector2d> some;
  for (std::size_t i = 0; i < kMaxFitPoints; ++i)
    some.push_back(body[i * body.size() / kMaxFitPoints]);
  return some;
}

/// @param max_height_m  points above it are of something else, such as a crown over a car.
ClusterShape shape_of(const Scene& scene, const std::vector<int>& cluster, float max_height_m) {
  ClusterShape shape;
  std::size_t touching = 0;
  for (const int column : cluster) {
    if (has_tall_neighbour(scene, column)) ++touching;
    for (std::uint32_t i = scene.grid.first(column); i < scene.grid.first(column + 1); ++i) {
      const RaisedPoint& point = scene.grid.points()[i];
      if (point.height_m >= max_height_m) continue;
      shape.points.push_back(point);
      shape.top_m = std::max(shape.top_m, static_cast<double>(point.height_m));
      shape.lowest_m = std::min(shape.lowest_m, static_cast<double>(point.height_m));
    }
  }
  for (const RaisedPoint& point : shape.points) shape.lidar += point.lidar.cast<double>();
  shape.lidar /= static_cast<double>(std::max<std::size_t>(shape.points.size(), 1));
  shape.touching_tall = static_cast<double>(touching) / static_cast<double>(cluster.size());
  if (!shape.points.empty()) shape.rectangle = fit_rectangle(outline_points(shape.points));
  return shape;
}

bool within(double value, const std::array<double, 2>& bounds) {
  return value >= bounds[0] && value <= bounds[1];
}

bool obeys(const ClusterShape& shape, const ShapeRule& rule) {
  const Eigen::Vector2d size = shape.rectangle.size();
  return shape.points.size() >= rule.points && within(size.maxCoeff(), rule.longer_m) &&
         within(size.minCoeff(), rule.shorter_m) && within(shape.top_m, rule.top_m) &&
         shape.lowest_m <= rule.lowest_m && shape.rectangle.outline_share >= rule.outline_share;
}

bool tall_inside(const Scene& scene, const Rectangle& r) {
  const double step_m = 0.5 * static_cast<double>(ColumnGrid::kCellM);
  const Eigen::Array2i steps = (r.size() / step_m).array().floor().cast<int>();
  for (int a = 0; a <= steps.x(); ++a) {
    for (int b = 0; b <= steps.y(); ++b) {
      const Eigen::Vector2d along = r.min + step_m * Eigen::Vector2d(a, b);
      const Eigen::Vector2f p = r.to_frame(along).cast<float>();
      const int column = ColumnGrid::column_of(p.x(), p.y());
      if (column >= 0 && scene.tall[static_cast<std::size_t>(column)] != 0) return true;
    }
  }
  return false;
}

/// Grows one axis to `full_m`, away from the sensor. @param sensor  along the rectangle's axes.
void grow(Rectangle& r, Eigen::Index axis, double full_m, const Eigen::Vector2d& sensor) {
  const double lacking_m = full_m - (r.max[axis] - r.min[axis]);
  if (lacking_m <= 0.0) return;
  if (r.min[axis] > sensor[axis]) {
    r.max[axis] += lacking_m;
  } else if (r.max[axis] < sensor[axis]) {
    r.min[axis] -= lacking_m;
  } else {
    r.min[axis] -= 0.5 * lacking_m;
    r.max[axis] += 0.5 * lacking_m;
  }
}

Eigen::Index longer_axis(const Rectangle& r) {
  const Eigen::Vector2d size = r.size();
  return size.x() >= size.y() ? 0 : 1;
}

/// Completes the hidden side. @return the axis of the length.
Eigen::Index complete(const Scene& scene, const ShapeRule& rule, const Eigen::Vector2d& lidar,
                      Rectangle& r) {
  const Eigen::Index longer = longer_axis(r);
  // Nothing as long as a car is seen: the wide face is its rear or front, the length lies behind
  // it.
  const bool face_only = rule.object_class == maps::ObjectClass::kCar && r.size().maxCoeff() < 2.4;
  const Eigen::Index length_axis = face_only ? 1 - longer : longer;
  const Eigen::Vector2d sensor = Eigen::Rotation2Dd(-r.yaw_rad) * lidar;
  Rectangle full = r;
  grow(full, length_axis, rule.length_m, sensor);
  grow(full, 1 - length_axis, rule.width_m, sensor);
  if (!tall_inside(scene, full)) r = full;
  return length_axis;
}

maps::Box box_of(const ClusterShape& shape, const Rectangle& r, Eigen::Index length_axis,
                 const ShapeRule& rule) {
  double top_z = -std::numeric_limits<double>::max();
  double bottom_z = std::numeric_limits<double>::max();
  for (const RaisedPoint& p : shape.points) {
    const double z = static_cast<double>(p.p_lidar.z());
    bottom_z = std::min(bottom_z, z - static_cast<double>(p.height_m));
    top_z = std::max(top_z, z);
  }
  bottom_z -= kBottomMarginM;
  top_z += kTopMarginM;
  const Eigen::Vector2d centre = r.to_frame(0.5 * (r.min + r.max));
  const Eigen::Vector2d size = r.size().cwiseMax(0.1);
  maps::Box box;
  box.centre = {centre.x(), centre.y(), 0.5 * (bottom_z + top_z)};
  box.size_m = {size[length_axis], size[1 - length_axis], top_z - bottom_z};
  box.yaw_rad = r.yaw_rad + (length_axis == 0 ? 0.0 : 0.5 * std::numbers::pi);
  box.object_class = rule.object_class;
  box.score = std::clamp(shape.rectangle.outline_share, 0.1, 1.0);
  return box;
}

/// Cars and people: clusters of columns that nothing at head height stands in.
void detect_low(const Scene& scene, std::vector<maps::Box>& boxes) {
  for (const std::vector<int>& cluster : scene.grid.clusters(scene.low, 1)) {
    const ClusterShape shape = shape_of(scene, cluster, kHeadBandM[0]);
    if (shape.touching_tall > kMaxTouching) continue;
    for (const ShapeRule& rule : kLowRules) {
      if (!obeys(shape, rule)) continue;
      Rectangle rectangle = shape.rectangle;
      const Eigen::Index length_axis = complete(scene, rule, shape.lidar, rectangle);
      boxes.push_back(box_of(shape, rectangle, length_axis, rule));
      break;
    }
  }
}

/// Vans and trucks reach head height themselves: their clusters are whatever stands together, and
/// nothing in them may be higher than a truck.
void detect_vans(const Scene& scene, std::vector<maps::Box>& boxes) {
  for (const std::vector<int>& cluster : scene.grid.clusters(scene.any, 1)) {
    const ClusterShape shape = shape_of(scene, cluster, ColumnGrid::kMaxHeightM);
    if (obeys(shape, kVanRule))
      boxes.push_back(box_of(shape, shape.rectangle, longer_axis(shape.rectangle), kVanRule));
  }
}

}  // namespace

std::vector<maps::Box> GeometricDetector::detect(const maps::Scan& scan,
                                                 const GroundResult& ground) const {
  const Scene scene = scene_of(scan.cloud, ground);
  std::vector<maps::Box> boxes;
  detect_low(scene, boxes);
  detect_vans(scene, boxes);
  return boxes;
}

}  // namespace stillmap::mapping
