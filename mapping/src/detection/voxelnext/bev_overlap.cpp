#include "detection/voxelnext/bev_overlap.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace stillmap::mapping {

namespace {

/// A rectangle cut by the four sides of another has at most 8 corners.
struct Polygon {
  std::array<Eigen::Vector2d, 8> corners;
  std::size_t count = 0;

  void add(const Eigen::Vector2d& corner) {
    // Rounding can only add corners that coincide with others.
    if (count < corners.size()) corners[count++] = corner;
  }
};

Eigen::Vector2d along_yaw(double yaw_rad) { return {std::cos(yaw_rad), std::sin(yaw_rad)}; }

/// Corners in b's own axes, counter-clockwise.
Polygon corners_seen_from(const maps::Box& a, const maps::Box& b) {
  const Eigen::Vector2d offset = (a.centre - b.centre).head<2>();
  const Eigen::Rotation2Dd R_b_world(-b.yaw_rad);
  const Eigen::Vector2d centre = R_b_world * offset;
  const Eigen::Vector2d u = along_yaw(a.yaw_rad - b.yaw_rad);
  const Eigen::Vector2d half_l = u * a.size_m.x() / 2.0;
  const Eigen::Vector2d half_w = Eigen::Vector2d(-u.y(), u.x()) * a.size_m.y() / 2.0;
  Polygon out;
  out.add(centre - half_l - half_w);
  out.add(centre + half_l - half_w);
  out.add(centre + half_l + half_w);
  out.add(centre - half_l + half_w);
  return out;
}

/// Keeps what lies at `sign * p[axis] <= limit` (Sutherland and Hodgman, "Reentrant polygon
/// clipping", CACM 1974).
Polygon cut(const Polygon& polygon, Eigen::Index axis, double sign, double limit) {
  Polygon out;
  for (std::size_t k = 0; k < polygon.count; ++k) {
    const Eigen::Vector2d& from = polygon.corners[k];
    const Eigen::Vector2d& to = polygon.corners[(k + 1) % polygon.count];
    const double before = sign * from[axis] - limit, after = sign * to[axis] - limit;
    if (before <= 0.0) out.add(from);
    if ((before < 0.0 && after > 0.0) || (before > 0.0 && after < 0.0))
      out.add(from + (to - from) * (before / (before - after)));
  }
  return out;
}

double area(const Polygon& polygon) {
  double twice = 0.0;
  for (std::size_t k = 0; k < polygon.count; ++k) {
    const Eigen::Vector2d& a = polygon.corners[k];
    const Eigen::Vector2d& b = polygon.corners[(k + 1) % polygon.count];
    twice += a.x() * b.y() - a.y() * b.x();
  }
  return std::max(twice / 2.0, 0.0);
}

double radius(const maps::Box& box) { return std::hypot(box.size_m.x(), box.size_m.y()) / 2.0; }

}  // namespace

double bev_iou(const maps::Box& a, const maps::Box& b) {
  Polygon shared = corners_seen_from(a, b);
  for (const double sign : {1.0, -1.0}) {
    shared = cut(shared, 0, sign, b.size_m.x() / 2.0);
    shared = cut(shared, 1, sign, b.size_m.y() / 2.0);
  }
  const double both = area(shared);
  const double all = a.size_m.x() * a.size_m.y() + b.size_m.x() * b.size_m.y() - both;
  return all > 0.0 ? std::clamp(both / all, 0.0, 1.0) : 0.0;
}

std::vector<maps::Box> suppress_overlaps(std::vector<maps::Box> boxes, double most_iou) {
  std::stable_sort(boxes.begin(), boxes.end(),
                   [](const maps::Box& a, const maps::Box& b) { return a.score > b.score; });
  std::vector<maps::Box> kept;
  // Circles around boxes: a low threshold leaves thousands of boxes, of which few are near another.
  std::vector<double> kept_radii;
  for (maps::Box& box : boxes) {
    const double own_radius = radius(box);
    bool overlaps = false;
    for (std::size_t k = 0; k < kept.size() && !overlaps; ++k) {
      const double reach = own_radius + kept_radii[k];
      overlaps = (box.centre - kept[k].centre).head<2>().squaredNorm() < reach * reach &&
                 bev_iou(box, kept[k]) > most_iou;
    }
    if (overlaps) continue;
    kept.push_back(std::move(box));
    kept_radii.push_back(own_radius);
  }
  return kept;
}

}  // namespace stillmap::mapping
