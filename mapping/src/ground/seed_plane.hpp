#pragma once

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace stillmap::mapping {

/// z = height + slope . (x, y) in the lidar frame.
struct SeedPlane {
  double height = 0.0;
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();
  /// Range up to which points were looked at to find it [m].
  double found_within_m = 0.0;

  [[nodiscard]] double z_at(double x, double y) const {
    return height + slope.x() * x + slope.y() * y;
  }
};

/// What is known of the sensor's height over the ground [m].
struct HeightPrior {
  double height_m = 0.0;
  double tolerance_m = 0.0;
};

/// The plane under the sensor from the lowest points of the cells around it [m, lidar frame]: the
/// one that most of them lie on and few lie below, among planes that pass below the sensor with a
/// slope of at most 0.3 (a street of 10 % and a sensor tilted by some degrees).
/// @return nothing when no plane holds at least 6 of them. Same input, same bits.
[[nodiscard]] std::optional<SeedPlane> find_seed_plane(
    const std::vector<Eigen::Vector3d>& lows, const std::optional<HeightPrior>& prior = {});

}  // namespace stillmap::mapping
