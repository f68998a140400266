#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/glb.hpp>
#include <stillmap/maps/partial_folder.hpp>
#include <stillmap/maps/tileset.hpp>

#include <fmt/format.h>

#include <span>
#include <string>
#include <vector>

#include "exports/export_formats.hpp"
#include "levels/level_writer.hpp"
#include "storage/write_file.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

Eigen::Matrix4d T_world_origin(const MapManifest& manifest) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  if (manifest.geodetic_origin) T = T_ecef_enu(*manifest.geodetic_origin);
  T.translate(manifest.origin);
  return T.matrix();
}

/// Writes files into a folder and counts them.
class Files {
 public:
  Files(const fs::path& folder, MapExportReport& report) : folder_(folder), report_(report) {}

  void write(const std::string& name, const std::string& bytes) {
    const fs::path file = folder_ / name;
    fs::create_directories(file.parent_path());
    write_file(file, bytes);
    ++report_.files;
    report_.bytes += bytes.size();
  }
  void write(TileId id, const char* ending, const std::string& bytes) {
    write(fmt::format("{}/{}/{}.{}", id.level, id.x, id.y, ending), bytes);
  }

 private:
  fs::path folder_;
  MapExportReport& report_;
};

}  // namespace

MapExportReport export_tiles3d(const MapPackage& map, const fs::path& out,
                               const MapExportOptions& options) {
  MapExportReport report;
  PartialFolder folder(out);
  Files files(folder.path(), report);
  std::vector<TileEntry> tiles;
  {
    // Never published: it goes at the end of this block.
    TileFileWriter levels(folder.path() / "levels.tiles", "export");
    LevelWriter(map, levels, options.work, options.without).run();
    if (options.without.empty()) {
      for (const TileEntry& tile : map.manifest().tiles) {
        if (tile.id.level != 0) continue;
        tiles.push_back(tile);
        files.write(tile.id, "glb", glb_of(tile, map.tile(tile.id)));
      }
    }
    for (const TileRow& row : levels.rows()) {
      tiles.push_back(row.entry());
      files.write(row.id(), "glb", glb_of(row.entry(), levels.read(row)));
    }
  }
  for (const TileEntry& tile : tiles) report.points += tile.id.level == 0 ? tile.points : 0;
  if (report.points == 0)
    throw InputError(map.folder().string(), "no point that is not left out", "one or more");
  const Tileset tileset(map, std::move(tiles));
  files.write("tileset.json", tileset.text(T_world_origin(map.manifest())));
  for (const TileId cut : tileset.cuts()) files.write(cut, "json", tileset.cut_text(cut));
  folder.publish();
  return report;
}

}  // namespace stillmap::maps
