#include "evaluation/paper/plain_map.hpp"

#include <utility>
#include <vector>

namespace stillmap::mapping {

void write_plain_map(const maps::MapPackage& map, const std::filesystem::path& target) {
  maps::MapPackageWriter writer(target);
  for (const maps::TileEntry& entry : map.tiles()) {
    const Eigen::Vector3d corner = maps::corner_of(entry.id);
    std::vector<maps::MapPoint> points = map.tile(entry.id).points_from(corner);
    for (maps::MapPoint& point : points) {
      if (maps::is_measured(point.kind)) continue;
      point.kind = maps::PointKind::kMeasured;
      point.object = 0;
    }
    writer.add_tile(entry.id, {map.manifest().origin, corner, std::move(points)});
  }
  const std::vector<maps::Trajectory> trajectories = map.trajectories();
  for (std::size_t i = 0; i < trajectories.size(); ++i) writer.write_trajectory(trajectories[i], i);
  (void)writer.publish(map.manifest(), "{}\n");
}

}  // namespace stillmap::mapping
