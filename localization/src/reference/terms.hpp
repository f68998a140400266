#pragma once

#include "reference/map_points.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <span>
#include <vector>

namespace stillmap::localization {

/// A scan point, the map point that it is compared with and what a method makes of the two.
struct Term {
  Eigen::Vector3d p_lidar = Eigen::Vector3d::Zero();
  const MapPoints::Point* point = nullptr;
  /// T_local_lidar p_lidar - point [m].
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  /// The part of the offset that the method minimises [m], in the axes of the map.
  Eigen::Vector3d residual = Eigen::Vector3d::Zero();
  /// Robust weight in (0, 1].
  double weight = 1.0;
};

/// What a reference method answers.
struct Registration {
  /// Lidar to the map's axes, relative to `MapPoints::origin()`.
  Eigen::Isometry3d T_local_lidar = Eigen::Isometry3d::Identity();
  /// At that pose; empty when too few points had a partner.
  std::vector<Term> terms;
  int iterations = 0;
  /// Size of the last step [m], rotations counted over `kLeverM`.
  double last_step_m = 0.0;
};

/// How a reference method is run.
struct ReferenceMethod {
  /// Edges of the cells that map and scan are thinned to [m].
  double map_leaf_m;
  double scan_leaf_m;
  /// @param points_lidar  thinned scan [m]. @param T_local_lidar  where it starts.
  Registration (*align)(const MapPoints& map, std::span<const Eigen::Vector3f> points_lidar,
                        const Eigen::Isometry3d& T_local_lidar);
};

/// Points farther than this from every map point have no partner [m].
inline constexpr float kMaxPairDistanceM = 2.0F;
/// With fewer pairs a method gives up.
inline constexpr std::size_t kMinPairs = 50;

/// Every scan point with its nearest map point within `max_distance_m`, the residual being the
/// whole offset.
[[nodiscard]] std::vector<Term> pair_up(const MapPoints& map,
                                        std::span<const Eigen::Vector3f> points_lidar,
                                        const Eigen::Isometry3d& T_local_lidar,
                                        float max_distance_m);

/// Size of a move [m], its rotation counted over `kLeverM`.
[[nodiscard]] double size_m(const Eigen::Isometry3d& move);

}  // namespace stillmap::localization
