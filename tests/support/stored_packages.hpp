#pragma once

#include <stillmap/maps/map_package.hpp>

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "support/package_steps.hpp"

namespace stillmap::test {

/// Name of the file in a package that a tile lies in, relative to the package.
inline std::string pack_of(const std::filesystem::path& package, maps::TileId tile = {}) {
  const std::string name = maps::MapPackage::open(package)->stored_name(tile).file;
  const std::filesystem::path file = name.substr(0, name.find(", tile"));
  return file.lexically_relative(package).string();
}

/// Writes a small map package whose content, and so its digest, depends on the seed.
/// @param points  of one tile.
/// @return its digest.
inline std::string write_package(const std::filesystem::path& target, int seed,
                                 std::size_t points = 100,
                                 std::optional<maps::Registration> registration = {},
                                 int schema = maps::kPackageSchema) {
  maps::MapPackageWriter writer(target, {}, schema);
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
