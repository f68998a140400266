#pragma once

#include "voxel_table.hpp"

#include <stillmap/maps/pose_disagreement.hpp>

#include <Eigen/Core>

#include <vector>

namespace stillmap::maps {
class MapPackage;
}

namespace stillmap::localization {

/// How far a map is bent or torn, by place: what the poses that it was made from disagree by.
class OwnError {
 public:
  /// Of a map that does not say.
  OwnError() = default;
  /// @throws maps::InputError.
  explicit OwnError(const maps::MapPackage& map);

  /// The largest within some 45 m; beyond what odometry itself is off by.
  [[nodiscard]] maps::PoseDisagreement near(const Eigen::Vector3d& at_map) const;

 private:
  VoxelTable columns_;
  std::vector<maps::PoseDisagreement> largest_;
};

}  // namespace stillmap::localization
