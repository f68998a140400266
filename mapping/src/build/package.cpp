#include "build/package.hpp"

#include "top_view.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>

#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {
namespace {

constexpr int kPictureSide = 1600;

using Tiles = std::map<maps::TileId, std::vector<maps::MapPoint>>;

void write_preview(const std::filesystem::path& file, const Tiles& tiles) {
  Eigen::Vector2d min = Eigen::Vector2d::Constant(std::numeric_limits<double>::max());
  Eigen::Vector2d max = -min;
  for (const auto& [id, points] : tiles) {
    for (const maps::MapPoint& p : points) {
      const Eigen::Vector2d xy = Eigen::Vector2f(p.x, p.y).cast<double>();
      min = min.cwiseMin(xy);
      max = max.cwiseMax(xy);
    }
  }
  TopView view(min - Eigen::Vector2d::Ones(), max + Eigen::Vector2d::Ones(), kPictureSide);
  for (const auto& [id, points] : tiles) {
    for (const maps::MapPoint& p : points)
      view.add_point(Eigen::Vector3f(p.x, p.y, p.z).cast<double>());
  }
  view.write_png(file);
}

void write_text(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text << std::flush;
  if (!out) throw maps::StorageError(file.string(), "cannot be written");
}

/// File of a `boxes:FILE` detector.
std::optional<std::filesystem::path> boxes_file_of(const MapBuildOptions& options) {
  constexpr std::string_view kBoxes = "boxes:";
  if (!options.detector.starts_with(kBoxes)) return std::nullopt;
  return options.detector.substr(kBoxes.size());
}

/// Files by their name alone: where they lay says nothing about the map.
std::map<std::string, std::string> texts_of(const MapBuildOptions& options) {
  const maps::Selection& selection = options.selection;
  const auto boxes_file = boxes_file_of(options);
  return {
      {"select", fmt::format("{}:{}:{}", selection.begin,
                             selection.end ? std::to_string(*selection.end) : "", selection.step)},
      {"poses", options.poses_file ? options.poses_file->filename().string() : "of the drive"},
      {"detector", boxes_file ? "boxes:" + boxes_file->filename().string() : options.detector},
      {"movable", std::string(name_of(options.projection.policy))},
      {"margin_m", fmt::format("{}", options.projection.margin_m)},
      {"voxel_size_m", fmt::format("{}", options.voxel_size_m)},
      {"min_range_m", fmt::format("{}", options.min_range_m)},
      {"max_range_m", fmt::format("{}", options.max_range_m)},
  };
}

std::map<std::string, std::string> sources_of(const BuildInputs& inputs) {
  const MapBuildOptions& options = inputs.options;
  std::map<std::string, std::string> sources{
      {"drive", std::filesystem::weakly_canonical(inputs.folder).filename().string()}};
  if (options.poses_file) sources["poses_sha256"] = maps::sha256_of_file(*options.poses_file);
  if (const auto file = boxes_file_of(options))
    sources["boxes_sha256"] = maps::sha256_of_file(*file);
  return sources;
}

}  // namespace

std::uint64_t write_contents(maps::MapPackageWriter& writer, const ScanStack& stack) {
  std::uint64_t points = 0;
  {
    // In a scope of its own: the tiles are as large as the map and not needed for the rest.
    const Tiles tiles = stack.map().tiles();
    for (const auto& [id, tile] : tiles) {
      writer.add_tile(id, tile);
      points += tile.size();
    }
    write_preview(writer.folder() / "preview.png", tiles);
  }
  writer.write_trajectory(maps::Trajectory(stack.poses()));
  writer.write_objects(stack.objects());
  write_text(writer.folder() / "sources.sha256", stack.sources());
  return points;
}

maps::MapManifest manifest_of(const BuildInputs& inputs, const Eigen::Vector3d& origin,
                              const MapBuildReport& report) {
  const maps::Drive& drive = inputs.drive;
  maps::MapManifest manifest;
  manifest.frame_id = drive.contents().origin ? "enu" : "local";
  manifest.origin = origin;
  manifest.geodetic_origin = drive.contents().origin;
  manifest.voxel_size_m = inputs.options.voxel_size_m;
  manifest.relative_clock = drive.relative_clock();
  manifest.software_version = STILLMAP_VERSION;
  manifest.options = texts_of(inputs.options);
  manifest.counts = report.points;
  for (const auto& [name, count] : report.objects) manifest.counts["objects_" + name] = count;
  manifest.counts["scans"] = report.scans;
  manifest.sources = sources_of(inputs);
  return manifest;
}

}  // namespace stillmap::mapping
