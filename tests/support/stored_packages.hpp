#pragma once

#include <stillmap/maps/map_package.hpp>

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::test {

/// Writes a small map package whose content, and so its digest, depends on the seed.
/// @param points  20 bytes each.
/// @return its digest.
inline std::string write_package(const std::filesystem::path& target, int seed,
                                 std::size_t points = 100,
                                 std::optional<maps::Registration> registration = {}) {
  maps::MapPackageWriter writer(target);
  std::vector<maps::MapPoint> tile(points);
  for (std::size_t i = 0; i < points; ++i)
    tile[i] = {static_cast<float>(i % 19U),
               static_cast<float>(seed),
               0,
               0,
               1,
               maps::PointKind::kMeasured,
               0};
  writer.add_tile({}, tile);
  maps::MapManifest manifest;
  manifest.frame_id = "map";
  manifest.registration = std::move(registration);
  return writer.publish(manifest, "{}");
}

}  // namespace stillmap::test
