#pragma once

#include <stillmap/maps/map_package.hpp>

#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "support/package_steps.hpp"

namespace stillmap::test {

/// A point of a small map, in map coordinates less its origin.
struct SmallMapPoint {
  Eigen::Vector3f p;
  float intensity = 0.5F;
  maps::PointKind kind = maps::PointKind::kMeasured;
  /// Scan that saw it.
  std::uint32_t scan = 0;
};

struct SmallMap {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  std::optional<maps::GeodeticOrigin> place;
  std::string frame_id = "town";
  std::vector<SmallMapPoint> points;
  /// One a drive.
  std::vector<maps::Trajectory> trajectories;
};

/// Writes it as a package and opens that.
[[nodiscard]] inline std::shared_ptr<const maps::MapPackage> published(
    const SmallMap& map, const std::filesystem::path& folder) {
  std::map<maps::TileId, std::vector<const SmallMapPoint*>> tiles;
  for (const SmallMapPoint& point : map.points)
    tiles[{0, static_cast<std::int32_t>(std::floor(point.p.x() / 20.0F)),
           static_cast<std::int32_t>(std::floor(point.p.y() / 20.0F))}]
        .push_back(&point);
  maps::MapPackageWriter writer(folder);
  for (const auto& [id, members] : tiles) {
    std::vector<maps::MapPoint> points;
    std::vector<maps::PointHistory> history;
    for (const SmallMapPoint* point : members) {
      points.push_back(
          {point->p.x(), point->p.y(), point->p.z(), point->intensity, 1, point->kind, 0});
      history.push_back({point->scan, point->scan, 0, {0, 0, 0}, 0});
    }
    writer.add_tile(id, points, history);
  }
  for (std::size_t drive = 0; drive < map.trajectories.size(); ++drive)
    writer.write_trajectory(map.trajectories[drive], drive);
  maps::MapManifest manifest;
  manifest.frame_id = map.frame_id;
  manifest.origin = map.origin;
  manifest.geodetic_origin = map.place;
  manifest.voxel_size_m = 0.1;
  manifest.software_version = "0.1.0";
  writer.publish(manifest, "{}");
  return maps::MapPackage::open(folder);
}

}  // namespace stillmap::test
