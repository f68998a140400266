#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/glb.hpp>
#include <stillmap/maps/tileset.hpp>

#include <fmt/format.h>

#include <string>
#include <utility>
#include <vector>

#include "exports/exporters.hpp"
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

/// Writes files into a folder.
class Files {
 public:
  explicit Files(fs::path folder) : folder_(std::move(folder)) {}

  void write(const std::string& name, const std::string& bytes) {
    const fs::path file = folder_ / name;
    fs::create_directories(file.parent_path());
    write_file(file, bytes);
  }
  void write(TileId id, const char* ending, const std::string& bytes) {
    write(fmt::format("{}/{}/{}.{}", id.level, id.x, id.y, ending), bytes);
  }

 private:
  fs::path folder_;
};

}  // namespace

void export_tiles3d(ExportJob& job) {
  const MapPackage& map = job.map;
  const MapExportOptions& options = job.options;
  Files files(job.target);
  std::vector<TileEntry> tiles;
  {
    // Never published: it goes at the end of this block.
    TileFileWriter levels(job.target / "levels.tiles", "export");
    LevelWriter(map, levels, options.work, options.without).run();
    if (options.without.empty()) {
      for (const TileEntry& tile : map.tiles()) {
        if (tile.id.level != 0) continue;
        tiles.push_back(tile);
        files.write(tile.id, "glb",
                    glb_of(tile, map.tile(tile.id).points_from(corner_of(tile.id))));
      }
    }
    for (const TileRow& row : levels.rows()) {
      tiles.push_back(row.entry(row.id()));
      files.write(row.id(), "glb", glb_of(tiles.back(), levels.read(row)));
    }
  }
  for (const TileEntry& tile : tiles) job.result.points += tile.id.level == 0 ? tile.points : 0;
  if (job.result.points == 0)
    throw InputError(map.folder().string(), "no point that is not left out",
                     "one or more: leave out fewer kinds (--without)");
  const Tileset tileset(map, std::move(tiles));
  files.write("tileset.json", tileset.text(T_world_origin(map.manifest())));
  for (const TileId cut : tileset.cuts()) files.write(cut, "json", tileset.cut_text(cut));
}

}  // namespace stillmap::maps
