#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstddef>

namespace stillmap::mapping {

/// A direction from the sensor and the distance along it.
struct Spherical {
  /// Counter-clockwise from +x, in [-pi, pi].
  float azimuth_rad = 0.0F;
  /// Upward from the x-y plane, in [-pi/2, pi/2].
  float elevation_rad = 0.0F;
  float range_m = 0.0F;
};

/// Angles within 1e-6 rad. @param p lidar frame [m].
[[nodiscard]] Spherical spherical_of(const Eigen::Vector3f& p);

/// The same for some points at once, four times as fast; the same bits.
class Directions {
 public:
  static constexpr std::size_t kMost = 256;

  /// Of T_lidar_points * p for `count` <= kMost points.
  void set(const Eigen::Isometry3f& T_lidar_points, const Eigen::Vector3f* points,
           std::size_t count);
  [[nodiscard]] Spherical operator[](std::size_t i) const {
    return {azimuth_rad_[i], elevation_rad_[i], range_m_[i]};
  }

 private:
  using Values = std::array<float, kMost>;
  Values x_, y_, z_, flat_m_, azimuth_rad_, elevation_rad_, range_m_;
};

}  // namespace stillmap::mapping
