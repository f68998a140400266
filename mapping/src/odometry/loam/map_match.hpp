#pragma once

#include "odometry/loam/feature_map.hpp"
#include "odometry/loam/features.hpp"
#include "odometry/loam/motion_fit.hpp"

#include <Eigen/Geometry>

#include <optional>
#include <vector>

namespace stillmap::mapping::loam {

/// Edges and planes of the sweeps so far, around the sensor.
struct FeatureMaps {
  FeatureMap edges;
  FeatureMap planes;
};

struct MapMatch {
  Eigen::Isometry3d T_odom_lidar = Eigen::Isometry3d::Identity();
  /// Of the pose: perturbation on the right, lidar frame.
  Matrix6 information = Matrix6::Zero();
  double variance_m2 = 0.0;
  /// Share of the features that lie within `kInlierM` of the map.
  double inlier_ratio = 0.0;
  /// What the first round found told.
  std::optional<Told> told;
  /// Looking for neighbours anew would change nothing.
  bool settled = false;
};

/// A round of lidar mapping (section VI) for one sweep: edges against lines, planes against planes
/// through the five nearest map points, whose distances are those of eq. (2) and (3).
/// @param edges, planes  at the scan's stamp, lidar frame. @param before  the round before; for the
/// first one its pose is where the search starts.
[[nodiscard]] MapMatch match_map(const std::vector<Feature>& edges,
                                 const std::vector<Feature>& planes, const FeatureMaps& maps,
                                 const MapMatch& before);

}  // namespace stillmap::mapping::loam
