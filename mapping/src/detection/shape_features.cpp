#include "detection/shape_features.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

/// Of the lower body, and of the windows, over the ground [m].
constexpr float kBodyFromM = 0.3F, kBodyToM = 0.65F;
constexpr float kCabinFromM = 1.0F, kCabinToM = 1.35F;
constexpr double kFlatM = 0.15;
constexpr double kSliceM = 0.25;

/// Distance to the nearest side that faces the sensor, which sits at the frame's origin [m].
double distance_to_facing(const Eigen::Vector2d& along, const Rectangle& r) {
  double distance_m = 10.0;
  for (Eigen::Index axis = 0; axis < 2; ++axis) {
    if (r.min[axis] > 0.0) distance_m = std::min(distance_m, std::abs(along[axis] - r.min[axis]));
    if (r.max[axis] < 0.0) distance_m = std::min(distance_m, std::abs(r.max[axis] - along[axis]));
  }
  return distance_m;
}

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Largest share of values that lie within `width` of each other.
double densest_share(std::vector<double>& values, double width) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  std::size_t most = 0, begin = 0;
  for (std::size_t end = 0; end < values.size(); ++end) {
    while (values[end] - values[begin] > width) ++begin;
    most = std::max(most, end - begin + 1);
  }
  return static_cast<double>(most) / static_cast<double>(values.size());
}

double high_share(const std::vector<Eigen::Vector2d>& along, const std::vector<RaisedPoint>& points,
                  const Rectangle& r) {
  const Eigen::Vector2d size = r.size();
  const Eigen::Index axis = size.x() >= size.y() ? 0 : 1;
  const auto slices = static_cast<std::size_t>(std::floor(size[axis] / kSliceM)) + 1;
  std::vector<float> tops(slices, 0.0F);
  float top = 0.0F;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double at = (along[i][axis] - r.min[axis]) / kSliceM;
    if (!(at >= 0.0 && at < static_cast<double>(slices))) continue;
    float& of_slice = tops[static_cast<std::size_t>(at)];
    of_slice = std::max(of_slice, points[i].height_m);
    top = std::max(top, points[i].height_m);
  }
  std::size_t seen = 0, high = 0;
  for (const float of_slice : tops) {
    seen += of_slice > 0.0F ? 1 : 0;
    high += of_slice > 0.75F * top ? 1 : 0;
  }
  return seen == 0 ? 0.0 : static_cast<double>(high) / static_cast<double>(seen);
}

}  // namespace

ShapeFeatures features_of(const std::vector<RaisedPoint>& points, const Rectangle& rectangle,
                          double top_slope) {
  const double c = std::cos(rectangle.yaw_rad), s = std::sin(rectangle.yaw_rad);
  std::vector<Eigen::Vector2d> along;
  along.reserve(points.size());
  std::vector<double> body, cabin;
  double highest_slope = -10.0;
  for (const RaisedPoint& point : points) {
    const Eigen::Vector3d p = point.p_lidar.cast<double>();
    along.emplace_back(c * p.x() + s * p.y(), c * p.y() - s * p.x());
    highest_slope = std::max(highest_slope, p.z() / p.head<2>().norm());
    const double distance_m = distance_to_facing(along.back(), rectangle);
    if (point.height_m >= kBodyFromM && point.height_m < kBodyToM) {
      body.push_back(distance_m);
    } else if (point.height_m >= kCabinFromM && point.height_m < kCabinToM) {
      cabin.push_back(distance_m);
    }
  }
  ShapeFeatures features;
  features.flatness = densest_share(body, kFlatM);
  if (!body.empty() && !cabin.empty()) features.inset_m = median(cabin) - median(body);
  features.high_share = high_share(along, points, rectangle);
  features.clearance = top_slope - highest_slope;
  return features;
}

}  // namespace stillmap::mapping
