#pragma once

#include "odometry/loam/features.hpp"
#include "odometry/loam/motion_fit.hpp"
#include "odometry/loam/previous_sweep.hpp"

#include <Eigen/Geometry>

#include <vector>

namespace stillmap::mapping::loam {

/// The sweep before, moved to its stamp.
struct PreviousSweep {
  RingSearch edges;
  RingSearch planes;
};

/// Points at the scan's stamp: X <- exp(twist time) X, the paper's re-projection (to the sweep's
/// end there). @param twist_lidar  (tx ty tz rx ry rz) [m/s, rad/s].
[[nodiscard]] std::vector<Feature> at_stamp(const std::vector<Feature>& features,
                                            const Eigen::Matrix<double, 6, 1>& twist_lidar);

struct SweepMatch {
  Motion T = Motion::Zero();
  /// Share of the edges and planes that lie within `kInlierM` of what they should.
  double inlier_ratio = 0.0;
  std::vector<Eigen::Matrix<double, 6, 1>> untold;
};

/// Lidar odometry (section V, Algorithm 1): motion of the sensor since the sweep before.
/// @param period_s  between the stamps, > 0. @param predicted  where the search starts; stays as it
/// is along what the sweep does not tell. @param off_m  what it may be off by.
[[nodiscard]] SweepMatch match_sweep(const Features& features, double period_s,
                                     const PreviousSweep& previous, const Motion& predicted,
                                     double off_m);

}  // namespace stillmap::mapping::loam
