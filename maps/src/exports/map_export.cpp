#include <fmt/format.h>
#include <fmt/ranges.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_export.hpp>
#include <stillmap/maps/partial_file.hpp>
#include <stillmap/maps/partial_folder.hpp>

#include <algorithm>
#include <stdexcept>

#include "exports/exporters.hpp"
#include "exports/file_coordinates.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

struct Row {
  MapExportFormat format;
  void (*run)(ExportJob& job);
};

using enum ExportFrame;

const std::vector<Row>& rows() {
  static const std::vector<Row> table = {
      {{"pcd",
        "PCD 0.7, binary floats x y z intensity",
        false,
        {.without = true, .kinds = true, .frames = {kMap, kLocal}}},
       export_pcd},
      {{"ply",
        "PLY 1.0, binary, x y z as doubles, intensity, kind",
        false,
        {.without = true, .frames = {kMap, kLocal, kUtm}}},
       export_ply},
      {{"las",
        "LAS 1.4, point format 6, millimetres, in UTM where the map's place is known",
        false,
        {.without = true, .frames = {kUtm, kMap, kLocal}}},
       export_las},
      {{"autoware",
        "Autoware: PCD tiles of 20 m with their metadata and projector (folder)",
        true,
        {.without = true, .frames = {kMap, kUtm, kMgrs, kTransverseMercator}}},
       export_autoware},
      {{"nav2",
        "Nav2: occupancy grid as PGM with YAML (folder)",
        true,
        {.without = true, .resolution = true, .height_band = true, .frames = {kMap, kLocal}}},
       export_nav2},
      {{"kitti", "trajectory, 12 numbers a line", false, {.drive = true, .frames = {kMap, kLocal}}},
       export_kitti},
      {{"tum",
        "trajectory, stamp and 7 numbers a line",
        false,
        {.drive = true, .frames = {kMap, kLocal}}},
       export_tum},
      {{"simplemap",
        "MRPT: keyframes of the trajectory, each with the map's points around it; by "
        "stillmap-rawlog",
        false,
        {.without = true, .frames = {kMap, kLocal}}},
       export_simplemap},
      {{"3dtiles",
        "a folder: 3D Tiles 1.1 with glTF points, levels of detail, for CesiumJS and other viewers",
        true,
        {.without = true, .frames = {kMap}}},
       export_tiles3d},
  };
  return table;
}

const Row& row_of(std::string_view name) {
  for (const Row& row : rows())
    if (row.format.name == name) return row;
  std::vector<std::string_view> names;
  for (const Row& row : rows()) names.push_back(row.format.name);
  throw std::invalid_argument(
      fmt::format("format: found '{}', expected one of {}", name, fmt::join(names, ", ")));
}

bool needs_place(ExportFrame frame) { return frame != kMap && frame != kLocal; }

/// What a format is written in when nobody says it: its first frame that the map has.
ExportFrame frame_of(const MapExportFormat& format, const MapExportOptions& options,
                     const MapPackage& map) {
  const bool has_place = map.manifest().geodetic_origin.has_value();
  if (!options.frame) {
    const auto& frames = format.uses.frames;
    return *std::find_if(frames.begin(), frames.end(),
                         [&](ExportFrame frame) { return has_place || !needs_place(frame); });
  }
  if (needs_place(*options.frame) && !has_place)
    throw InputError(map.folder().string(), "a map without a geodetic origin",
                     fmt::format("one for {}: build or import with --geo-origin",
                                 *options.frame == kUtm ? "UTM" : name_of(*options.frame)));
  return *options.frame;
}

void count_files(const fs::path& target, MapExportResult& result) {
  const auto add = [&](const fs::path& file) {
    ++result.files;
    result.bytes += fs::file_size(file);
  };
  if (fs::is_regular_file(target)) return add(target);
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(target))
    if (entry.is_regular_file()) add(entry.path());
}

template <typename Partial>
void run_into(const Row& row, Partial& partial, ExportJob& job) {
  job.target = partial.path();
  row.run(job);
  count_files(job.target, job.result);
  partial.publish();
}

}  // namespace

std::string_view name_of(ExportFrame frame) {
  switch (frame) {
    case kMap:
      return "map";
    case kLocal:
      return "local";
    case kUtm:
      return "utm";
    case kMgrs:
      return "mgrs";
    case kTransverseMercator:
      return "transverse-mercator";
  }
  return "";
}

std::vector<std::string> MapExportOptions::violations() const {
  std::vector<std::string> broken;
  if (resolution_m && !(*resolution_m >= 0.02 && *resolution_m <= 5.0))
    broken.push_back(
        fmt::format("resolution_m (--resolution): {}, expected in [0.02, 5]", *resolution_m));
  if (height_band_m) {
    const auto [low, high] = *height_band_m;
    if (!(low >= -5.0 && low < high && high <= 50.0))
      broken.push_back(fmt::format(
          "height_band_m (--height-band): {} to {}, expected in [-5, 50], the second larger", low,
          high));
  }
  return broken;
}

const std::vector<MapExportFormat>& map_export_formats() {
  static const std::vector<MapExportFormat> formats = [] {
    std::vector<MapExportFormat> all;
    for (const Row& row : rows()) all.push_back(row.format);
    return all;
  }();
  return formats;
}

void check_export_options(const MapExportFormat& format, const MapExportOptions& options) {
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument(broken.front());
  const auto refuse = [&](bool set, bool used, const char* name) {
    if (set && !used)
      throw std::invalid_argument(
          fmt::format("{}: found with format {}, which has no use for it", name, format.name));
  };
  refuse(!options.without.empty(), format.uses.without, "without");
  refuse(options.kinds, format.uses.kinds, "kinds");
  refuse(options.resolution_m.has_value(), format.uses.resolution, "resolution_m");
  refuse(options.height_band_m.has_value(), format.uses.height_band, "height_band_m");
  refuse(options.drive.has_value(), format.uses.drive, "drive");
  const auto& frames = format.uses.frames;
  if (!options.frame || std::find(frames.begin(), frames.end(), *options.frame) != frames.end())
    return;
  std::vector<std::string_view> names;
  for (const ExportFrame frame : frames) names.push_back(name_of(frame));
  throw std::invalid_argument(
      fmt::format("frame: found {} with format {}, expected {}{}", name_of(*options.frame),
                  format.name, fmt::join(names, " or "),
                  *options.frame == kUtm ? " (32-bit floats are half a metre coarse in UTM)" : ""));
}

Eigen::Vector3d local_origin(const MapPackage& map) {
  constexpr double kKilometreM = 1000.0;
  Eigen::AlignedBox3d bounds;
  for (const TileEntry& tile : point_tiles(map)) bounds.extend(tile.from_origin());
  const Eigen::Vector3d& origin = map.manifest().origin;
  if (bounds.isEmpty() ||
      bounds.min().cwiseAbs().cwiseMax(bounds.max().cwiseAbs()).maxCoeff() < kCoarseFromM)
    return origin;
  const Eigen::Vector3d kilometres = (bounds.center() / kKilometreM).array().round();
  return origin + kKilometreM * kilometres;
}

MapExportResult export_map(const MapPackage& map, std::string_view format,
                           const std::filesystem::path& target, const MapExportOptions& options) {
  const Row& row = row_of(format);
  check_export_options(row.format, options);
  MapExportResult result;
  ExportJob job{map, options, frame_of(row.format, options, map), {}, result};
  job.tell({0.0, 0.0}, 0, 1);
  if (job.frame == kLocal) result.origin = local_origin(map);
  const auto& facts = map.manifest().options;
  if (const auto taken = facts.find("taken_as_wgs84"); taken != facts.end())
    result.notes.push_back("the import took as WGS 84 what may be metres off: " + taken->second);
  if (row.format.is_folder) {
    PartialFolder partial(target);
    run_into(row, partial, job);
  } else {
    PartialFile partial(target);
    run_into(row, partial, job);
  }
  return result;
}

}  // namespace stillmap::maps
