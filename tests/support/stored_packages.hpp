#pragma once

#include <stillmap/maps/map_package.hpp>

#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <set>
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

/// Writes a package of ten tiles to FOLDER/0, and two patches of it to FOLDER/1 and FOLDER/2. The
/// first leaves seven tiles in the first pack. The second leaves three there, less than half, so
/// that they are written again.
inline void write_patched_packages(const std::filesystem::path& folder) {
  const auto tile = [](std::int32_t x, int seed) {
    std::vector<maps::MapPoint> points(1000);
    for (std::size_t i = 0; i < points.size(); ++i)
      points[i] = {static_cast<float>(20 * x) + static_cast<float>(i % 19U),
                   static_cast<float>(seed),
                   0,
                   0,
                   1,
                   maps::PointKind::kMeasured,
                   0};
    return points;
  };
  std::filesystem::create_directory(folder);
  for (int seed = 0; seed < 3; ++seed) {
    const std::vector<std::int32_t> changed = seed == 1 ? std::vector{0, 1, 2}
                                              : seed == 2
                                                  ? std::vector{3, 4, 5, 6}
                                                  : std::vector{0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
    maps::MapPackageWriter writer(folder / std::to_string(seed));
    std::shared_ptr<const maps::MapPackage> before;
    if (seed > 0) {
      std::set<maps::TileId> except;
      for (const std::int32_t x : changed) except.insert({0, x, 0});
      before = maps::MapPackage::open(folder / std::to_string(seed - 1));
      writer.take_over(*before, except);
    }
    for (const std::int32_t x : changed) writer.add_tile({0, x, 0}, tile(x, seed));
    maps::MapManifest manifest;
    manifest.frame_id = "map";
    writer.publish(manifest, "{}");
  }
}

/// Tiles of packages that share one: `kSharedTile` is the same for all seeds, `kOwnTile` is not.
inline constexpr maps::TileId kSharedTile{0, 0, 0}, kOwnTile{0, 40, 0};
/// @return the digest.
inline std::string write_sharing_package(const std::filesystem::path& target, int seed) {
  const auto points = [](int of, float x) {
    std::vector<maps::MapPoint> tile(3000);
    for (std::size_t i = 0; i < tile.size(); ++i)
      tile[i] = {x + static_cast<float>(i % 19U),
                 static_cast<float>(of),
                 0,
                 0,
                 1,
                 maps::PointKind::kMeasured,
                 0};
    return tile;
  };
  maps::MapPackageWriter writer(target);
  writer.add_tile(kSharedTile, points(0, 0.0F));
  writer.add_tile(kOwnTile, points(seed, 800.0F));
  // Two files of equal bytes, as those of two drives without objects are.
  for (const char* name : {"one.txt", "other.txt"})
    std::ofstream(writer.folder() / name) << "of seed " << seed << "\n";
  maps::MapManifest manifest;
  manifest.frame_id = "map";
  return writer.publish(manifest, "{}");
}

}  // namespace stillmap::test
