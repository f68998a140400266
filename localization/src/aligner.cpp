#include <stillmap/localization/aligner.hpp>

#include "align/voxel_aligner.hpp"
#include "reference/icp.hpp"
#include "reference/point_to_plane.hpp"
#include "reference/reference_aligner.hpp"

#include <fmt/format.h>

#include <array>
#include <stdexcept>

namespace stillmap::localization {
namespace {

/// What follows the default in `aligner_names()`.
struct NamedReference {
  std::string_view name;
  const ReferenceMethod& (*method)();
};
constexpr std::array<NamedReference, 2> kReferences = {
    {{"icp", icp}, {"point_to_plane", point_to_plane}}};

[[noreturn]] void refuse(std::string_view method) {
  throw std::invalid_argument(fmt::format("method: found '{}', expected one of: {}", method,
                                          fmt::join(aligner_names(), ", ")));
}

}  // namespace

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

ThinScan Aligner::thin(const ScanView& scan_lidar) const { return whole_scan(scan_lidar); }

AlignmentResult Aligner::align_thin(const ThinScan& scan_lidar,
                                    const std::optional<Prior>& prior) const {
  return align(scan_lidar.points_lidar, prior);
}

std::vector<std::string> aligner_names() {
  std::vector<std::string> names = {"default"};
  for (const NamedReference& reference : kReferences) names.emplace_back(reference.name);
  return names;
}

std::vector<Eigen::Isometry3d> seen_from(const maps::MapPackage& map) {
  std::vector<Eigen::Isometry3d> poses;
  for (const maps::Trajectory& drive : map.trajectories()) {
    for (const maps::StampedPose& pose : drive.poses()) poses.push_back(pose.T_map_lidar);
  }
  return poses.empty() ? map.places() : poses;
}

std::unique_ptr<Aligner> make_aligner(std::string_view method, const maps::MapPackage& map,
                                      const LocalizationOptions& options) {
  if (method == "default") return make_aligner(method, MapIndex::open(map), {}, options);
  for (const NamedReference& reference : kReferences) {
    if (reference.name != method) continue;
    return std::make_unique<ReferenceAligner>(MapPoints::build(map, reference.method().map_leaf_m),
                                              reference.method());
  }
  refuse(method);
}

std::unique_ptr<Aligner> make_aligner(std::string_view method,
                                      std::shared_ptr<const MapIndex> index,
                                      const std::vector<Eigen::Isometry3d>& T_map_lidar_seen_from,
                                      const LocalizationOptions& options) {
  for (const NamedReference& reference : kReferences) {
    if (reference.name != method) continue;
    throw std::invalid_argument(
        fmt::format("method: found '{}', which needs a map's points, not its index alone", method));
  }
  if (method != "default") refuse(method);
  return std::make_unique<VoxelAligner>(std::move(index), T_map_lidar_seen_from, options);
}

}  // namespace stillmap::localization
