#pragma once

#include <Eigen/Geometry>

#include <cstdint>
#include <vector>

namespace stillmap::simulation {

/// Measures of the street's section [m], from the middle outwards.
struct StreetSection {
  static constexpr double kLaneMiddle = 1.5;
  static constexpr double kParkingMiddle = 4.1;
  static constexpr double kKerb = 5.2;
  static constexpr double kKerbHeight = 0.12;
  static constexpr double kPavementEnd = 7.7;
  /// Ground ends here; inside the tightest bend's radius.
  static constexpr double kEnd = 26.0;
};

/// Middle line of a winding, climbing street and the ground on both sides of it.
///
/// Places are given by `s`, the length along the middle line, and `d`, the offset to its left [m].
/// The street starts level with the world's x axis at s = 0, and depends on the seed alone, not on
/// its length.
class Road {
 public:
  /// @param begin_m, end_m  range of s that can be asked for; begin_m <= 0 < end_m.
  Road(std::uint64_t seed, double begin_m, double end_m);

  [[nodiscard]] double begin_m() const { return begin_m_; }
  [[nodiscard]] double end_m() const { return end_m_; }
  /// Direction of the middle line, counter-clockwise from the world's +x [rad].
  [[nodiscard]] double heading_rad(double s) const;
  /// Point on the ground, its roughness left out.
  [[nodiscard]] Eigen::Vector3d surface(double s, double d) const;
  /// Frame on the ground: x along the street turned by `yaw_rad`, z along the ground's normal.
  [[nodiscard]] Eigen::Isometry3d T_world_ground(double s, double d, double yaw_rad) const;
  /// Frame at the same place with z straight up.
  [[nodiscard]] Eigen::Isometry3d T_world_upright(double s, double d, double yaw_rad) const;

 private:
  [[nodiscard]] Eigen::Vector2d middle(double s) const;
  [[nodiscard]] double height(double s) const;

  std::uint64_t seed_;
  double begin_m_;
  double end_m_;
  double climb_phase_rad_;
  /// Middle line every kStep metres from begin_m_.
  std::vector<Eigen::Vector2d> middle_;
};

}  // namespace stillmap::simulation
