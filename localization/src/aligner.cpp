#include <stillmap/localization/aligner.hpp>

#include "voxel_aligner.hpp"

#include <fmt/format.h>

#include <stdexcept>

namespace stillmap::localization {

std::string_view name_of(PoseStatus status) {
  switch (status) {
    case PoseStatus::kOk:
      return "ok";
    case PoseStatus::kDegraded:
      return "degraded";
    case PoseStatus::kLost:
      return "lost";
  }
  throw std::invalid_argument(fmt::format("PoseStatus: {}, unknown", static_cast<int>(status)));
}

std::vector<std::string> aligner_names() { return {"default"}; }

std::vector<Eigen::Isometry3d> seen_from(const maps::MapPackage& map) {
  const maps::Trajectory trajectory = map.trajectory();
  std::vector<Eigen::Isometry3d> poses;
  for (const maps::StampedPose& pose : trajectory.poses()) poses.push_back(pose.T_map_lidar);
  return poses;
}

std::unique_ptr<Aligner> make_aligner(std::string_view method,
                                      std::shared_ptr<const MapIndex> index,
                                      const std::vector<Eigen::Isometry3d>& T_map_lidar_seen_from) {
  if (method == "default") {
    return std::make_unique<VoxelAligner>(std::move(index), T_map_lidar_seen_from);
  }
  throw std::invalid_argument(fmt::format("method: found '{}', expected one of: {}", method,
                                          fmt::join(aligner_names(), ", ")));
}

}  // namespace stillmap::localization
