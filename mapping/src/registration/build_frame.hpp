#pragma once

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <string>

namespace stillmap::mapping {

/// What a map takes over from the one that it is registered to.
struct BuildFrame {
  std::string frame_id;
  /// Of the tiles, so that they are the same cells of the same places [m].
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  maps::Registration registration;
};

}  // namespace stillmap::mapping
