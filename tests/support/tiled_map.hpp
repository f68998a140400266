#pragma once

#include <stillmap/maps/map_package.hpp>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "support/package_steps.hpp"
#include "support/synthetic_world.hpp"

namespace stillmap::test {

inline maps::MapPoint map_point(float x, float y, float z,
                                maps::PointKind kind = maps::PointKind::kMeasured,
                                std::uint16_t observations = 1) {
  return {x, y, z, 0.5F, observations, kind, 0};
}

/// A map package of these points (relative to its origin), each in its tile of level 0.
/// @param add  writes further files.
inline std::shared_ptr<const maps::MapPackage> write_map(
    const std::filesystem::path& target, const std::vector<maps::MapPoint>& points,
    maps::MapManifest manifest = {}, const std::function<void(maps::MapPackageWriter&)>& add = {}) {
  std::map<maps::TileId, std::vector<maps::MapPoint>> tiles;
  for (const maps::MapPoint& p : points) {
    const auto index = [](float value) {
      return static_cast<std::int32_t>(std::floor(static_cast<double>(value) / maps::kTileSizeM));
    };
    tiles[{.level = 0, .x = index(p.x), .y = index(p.y)}].push_back(p);
  }
  maps::MapPackageWriter writer(target);
  for (const auto& [id, tile] : tiles) writer.add_tile(id, tile);
  if (manifest.frame_id.empty()) manifest.frame_id = "map";
  if (manifest.voxel_size_m == 0.0) manifest.voxel_size_m = 0.1;
  if (add) add(writer);
  writer.publish(manifest, "{}");
  return maps::MapPackage::open(target);
}

/// Points on the ground and on a wall here and there in a square around the origin, some four a
/// square metre.
inline std::vector<maps::MapPoint> scattered(double half_width_m, std::uint64_t seed = 1) {
  Random random(seed);
  std::vector<maps::MapPoint> points;
  const auto count = static_cast<std::size_t>(16.0 * half_width_m * half_width_m);
  for (std::size_t i = 0; i < count; ++i) {
    maps::MapPoint p = map_point(static_cast<float>(random.uniform(-half_width_m, half_width_m)),
                                 static_cast<float>(random.uniform(-half_width_m, half_width_m)),
                                 static_cast<float>(random.uniform(0.0, 0.05)));
    if (i % 5 == 0) p.z = static_cast<float>(random.uniform(0.0, 6.0));
    p.kind = static_cast<maps::PointKind>(i % 4);
    p.observations = static_cast<std::uint16_t>(1 + i % 7);
    points.push_back(p);
  }
  return points;
}

}  // namespace stillmap::test
