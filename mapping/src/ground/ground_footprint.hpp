#pragma once

#include <stillmap/maps/box.hpp>

#include <Eigen/Core>

#include <cmath>

namespace stillmap::mapping {

/// Where an object stood, seen from above; local frame.
struct GroundFootprint {
  /// Of the object [m].
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  /// Half of length and width [m], each > 0.
  Eigen::Vector2d half_m = Eigen::Vector2d::Ones();
  /// Direction of the length.
  Eigen::Vector2d heading = Eigen::Vector2d::UnitX();

  /// Place along the length and across it [m] from the centre.
  [[nodiscard]] Eigen::Vector2d inside(const Eigen::Vector2d& p) const {
    const Eigen::Vector2d d = p - centre.head<2>();
    return {heading.dot(d), heading.x() * d.y() - heading.y() * d.x()};
  }
  [[nodiscard]] bool covers(const Eigen::Vector2d& p, double margin_m = 0.0) const {
    return ((inside(p).cwiseAbs() - half_m).array() <= margin_m).all();
  }
  /// Half the sides of the footprint's bounds along x and y, grown by a margin [m].
  [[nodiscard]] Eigen::Vector2d reach(double margin_m) const {
    const Eigen::Vector2d half = half_m.array() + margin_m;
    const Eigen::Vector2d h = heading.cwiseAbs();
    return {h.x() * half.x() + h.y() * half.y(), h.y() * half.x() + h.x() * half.y()};
  }
};

/// @param box  local frame, finite.
[[nodiscard]] inline GroundFootprint footprint_of(const maps::Box& box) {
  return {box.centre, 0.5 * box.size_m.head<2>(),
          Eigen::Vector2d(std::cos(box.yaw_rad), std::sin(box.yaw_rad))};
}

}  // namespace stillmap::mapping
