// Writes small maps of one street, each with another digest, a scan of it and a drive through it:
// what the soak tests publish, ask and rebuild. Of schema 2 every second map is a patch of the one
// before, with which it shares files; of every fourth more than half of the tiles are new, so that
// the others are written again.
//
// usage: tiny_packages FOLDER COUNT      makes FOLDER/1 ... FOLDER/COUNT, FOLDER/scan.bin, seen
// from (60, 0, 1.8), and FOLDER/drive

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/trajectory.hpp>

#include "support/synthetic_world.hpp"

#include <cmath>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace {

namespace fs = std::filesystem;
namespace maps = stillmap::maps;
using stillmap::test::pose_at;

stillmap::test::ScanPattern pattern(std::uint64_t seed) {
  return {.rings = 32, .columns = 360, .noise_m = 0.02, .seed = seed};
}

/// @param before  what it is a patch of; nothing: it is a map of its own.
void write_package(const fs::path& target, int seed, int schema,
                   const std::optional<fs::path>& before) {
  std::vector<Eigen::Isometry3d> poses;
  for (double x = 50.0; x <= 70.0; x += 2.5) poses.push_back(pose_at(x, 0.0, 0.0));
  const std::vector<Eigen::Vector3d> points = stillmap::test::street(21).mapped_from(
      poses, pattern(static_cast<std::uint64_t>(100 * seed)));
  std::map<std::pair<std::int32_t, std::int32_t>, std::vector<maps::MapPoint>> tiles;
  for (const Eigen::Vector3d& p : points) {
    const auto tile = [](double x) {
      return static_cast<std::int32_t>(std::floor(x / maps::kTileSizeM));
    };
    const Eigen::Vector3f q = p.cast<float>();
    tiles[{tile(p.x()), tile(p.y())}].push_back({.x = q.x(),
                                                 .y = q.y(),
                                                 .z = q.z(),
                                                 .intensity = 0,
                                                 .observations = 1,
                                                 .kind = maps::PointKind::kMeasured,
                                                 .object = 0});
  }
  maps::MapPackageWriter writer(target, {}, schema);
  std::shared_ptr<const maps::MapPackage> patched;
  if (before) {
    const std::size_t most = seed % 4 == 0 ? tiles.size() - 1 : 1;
    while (tiles.size() > most) tiles.erase(tiles.begin());
    std::set<maps::TileId> changed;
    for (const auto& [id, tile] : tiles) changed.insert({0, id.first, id.second});
    patched = maps::MapPackage::open(*before);
    writer.take_over(*patched, changed);
  }
  for (const auto& [id, tile] : tiles)
    writer.add_tile({.level = 0, .x = id.first, .y = id.second}, tile);
  std::vector<maps::StampedPose> drive;
  for (std::size_t i = 0; i < poses.size(); ++i)
    drive.push_back(
        {.stamp_ns = static_cast<std::int64_t>(i + 1) * 1'000'000'000, .T_map_lidar = poses[i]});
  writer.write_trajectory(maps::Trajectory(drive));
  maps::MapManifest manifest;
  manifest.frame_id = "map";
  manifest.voxel_size_m = 0.1;
  writer.publish(manifest, "{}");
}

void write_scan(const fs::path& file, const Eigen::Isometry3d& T_map_lidar, std::uint64_t seed) {
  const maps::PointCloud scan = stillmap::test::street(21).scan(T_map_lidar, pattern(seed));
  std::ofstream stream(file, std::ios::binary);
  for (const Eigen::Vector3f& p : scan.positions) {
    const std::array<float, 4> row = {p.x(), p.y(), p.z(), 0.0F};
    stream.write(reinterpret_cast<const char*>(row.data()), sizeof(row));
  }
  if (!stream.flush()) throw std::runtime_error(file.string() + " cannot be written");
}

/// As many scans as a gate asks for (20), along what the packages map.
void write_drive(const fs::path& folder) {
  constexpr int kScans = 24;
  fs::create_directories(folder);
  std::vector<maps::StampedPose> poses;
  for (int i = 0; i < kScans; ++i) {
    const Eigen::Isometry3d T_map_lidar = pose_at(50.0 + 0.8 * i, 0.0, 0.0);
    poses.push_back(
        {.stamp_ns = static_cast<std::int64_t>(i + 1) * 100'000'000, .T_map_lidar = T_map_lidar});
    write_scan(folder / (std::to_string(i) + ".bin"), T_map_lidar,
               static_cast<std::uint64_t>(1000 + i));
  }
  maps::write_tum_trajectory(folder / "poses.tum", maps::Trajectory(poses));
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 4) {
    std::cerr << "usage: tiny_packages FOLDER COUNT SCHEMA\n";
    return 2;
  }
  try {
    const fs::path folder = arguments[1];
    fs::create_directories(folder);
    const int schema = std::stoi(arguments[3]);
    for (int seed = 1; seed <= std::stoi(arguments[2]); ++seed) {
      const bool is_patch = schema == 2 && seed % 2 == 0;
      write_package(folder / std::to_string(seed), seed, schema,
                    is_patch ? std::optional(folder / std::to_string(seed - 1)) : std::nullopt);
    }
    write_scan(folder / "scan.bin", pose_at(60.0, 0.0, 0.0), 7);
    write_drive(folder / "drive");
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
  return 0;
}
