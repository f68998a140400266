#include "reference/directions.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

// Loops without branches, which the compiler turns into vector instructions (std::sqrt because this
// file is compiled without errno for it): half of the time of these methods would go into
// std::atan2.
namespace stillmap::mapping {
namespace {

constexpr float kFloatPi = std::numbers::pi_v<float>;

/// Odd polynomial on [-1, 1], error below 3e-7 rad.
float atan_of(float t) {
  const float s = t * t;
  return t *
         (0.99999611F +
          s * (-0.33317368F +
               s * (0.19807816F + s * (-0.13233342F +
                                       s * (0.07962367F + s * (-0.03360422F + s * 0.00681179F))))));
}

/// atan2 of two numbers >= 0; pi/4 when both are 0.
float quadrant_angle(float y, float x) {
  constexpr float kSmallest = 1e-30F;
  return 0.25F * kFloatPi + atan_of((y - x) / std::max(x + y, kSmallest));
}

float azimuth_of(float x, float y) {
  const float from_y_axis = 0.5F * kFloatPi - quadrant_angle(std::abs(y), std::abs(x));
  return std::copysign(0.5F * kFloatPi - std::copysign(from_y_axis, x), y);
}

float elevation_of(float flat, float z) {
  return std::copysign(quadrant_angle(std::abs(z), flat), z);
}

}  // namespace

Spherical spherical_of(const Eigen::Vector3f& p) {
  const float flat2 = p.x() * p.x() + p.y() * p.y();
  return {azimuth_of(p.x(), p.y()), elevation_of(std::sqrt(flat2), p.z()),
          std::sqrt(flat2 + p.z() * p.z())};
}

void Directions::set(const Eigen::Isometry3f& T_lidar_points, const Eigen::Vector3f* points,
                     std::size_t count) {
  const Eigen::Matrix3f R = T_lidar_points.linear();
  const Eigen::Vector3f t = T_lidar_points.translation();
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3f& p = points[i];
    x_[i] = R(0, 0) * p.x() + R(0, 1) * p.y() + R(0, 2) * p.z() + t.x();
    y_[i] = R(1, 0) * p.x() + R(1, 1) * p.y() + R(1, 2) * p.z() + t.y();
    z_[i] = R(2, 0) * p.x() + R(2, 1) * p.y() + R(2, 2) * p.z() + t.z();
  }
  for (std::size_t i = 0; i < count; ++i) {
    const float flat2 = x_[i] * x_[i] + y_[i] * y_[i];
    flat_m_[i] = std::sqrt(flat2);
    range_m_[i] = std::sqrt(flat2 + z_[i] * z_[i]);
  }
  for (std::size_t i = 0; i < count; ++i) {
    azimuth_rad_[i] = azimuth_of(x_[i], y_[i]);
    elevation_rad_[i] = elevation_of(flat_m_[i], z_[i]);
  }
}

}  // namespace stillmap::mapping
