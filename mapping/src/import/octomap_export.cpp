#include <stillmap/mapping/octomap_export.hpp>

#include <fmt/format.h>
#include <octomap/OcTree.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/partial_file.hpp>

#include <fstream>

namespace stillmap::mapping {
namespace {

constexpr double kResolutionM = 0.2;
constexpr std::size_t kMostLeaves = 50'000'000;

/// The chosen points of a tile, into leaves. @param origin  taken off their coordinates.
/// @return how many they are.
std::size_t add_tile(const maps::MapPackage& map, maps::TileId id,
                     const maps::MapExportOptions& options, const Eigen::Vector3d& origin,
                     octomap::OcTree& tree) {
  std::size_t points = 0;
  const maps::MapTile tile = map.tile(id);
  for (const maps::MapPoint& point : tile) {
    if (options.without.contains(point.kind)) continue;
    const Eigen::Vector3d p = tile.from_origin(point) + (map.manifest().origin - origin);
    octomap::OcTreeKey key;
    if (!tree.coordToKeyChecked(p.x(), p.y(), p.z(), key))
      throw maps::InputError(
          map.folder().string(), fmt::format("a point at {} {} {}", p.x(), p.y(), p.z()),
          fmt::format("all within {:.0f} m of zero: a coarser --resolution, or --coordinates local",
                      32768.0 * tree.getResolution()));
    // Lazily: inner nodes are brought up to date once, at the end.
    tree.setNodeValue(key, tree.getClampingThresMaxLog(), true);
    ++points;
  }
  return points;
}

void write(octomap::OcTree& tree, const std::filesystem::path& target) {
  maps::PartialFile partial(target);
  std::ofstream stream(partial.path(), std::ios::binary);
  const bool written = stream && tree.writeBinaryConst(stream);
  stream.close();
  if (!written || !stream) throw maps::StorageError(target.string(), "could not be written");
  partial.publish();
}

}  // namespace

const maps::MapExportFormat& octomap_format() {
  using enum maps::ExportFrame;
  static const maps::MapExportFormat format{
      "octomap",
      "OctoMap: occupied leaves as a binary OcTree (.bt)",
      false,
      {.without = true, .resolution = true, .frames = {kMap, kLocal}}};
  return format;
}

maps::MapExportResult export_octomap(const maps::MapPackage& map,
                                     const std::filesystem::path& target,
                                     const maps::MapExportOptions& options) {
  maps::check_export_options(octomap_format(), options);
  maps::MapExportResult result;
  if (options.frame == maps::ExportFrame::kLocal) result.origin = maps::local_origin(map);
  octomap::OcTree tree(options.resolution_m.value_or(kResolutionM));
  std::size_t points = 0, done = 0;
  const std::vector<maps::TileEntry> tiles = map.tiles();
  for (const maps::TileEntry& tile : tiles) {
    if (tile.id.level == 0) points += add_tile(map, tile.id, options, result.origin, tree);
    if (tree.size() > kMostLeaves)
      throw maps::InputError(map.folder().string(), fmt::format("more than {} nodes", kMostLeaves),
                             "a coarser --resolution");
    const double share = static_cast<double>(++done) / static_cast<double>(tiles.size());
    if (options.work.go_on && !options.work.go_on(share)) throw maps::WorkStopped();
  }
  if (points == 0)
    throw maps::InputError(map.folder().string(), "no point that is not left out",
                           "one or more: leave out fewer kinds (--without)");
  tree.updateInnerOccupancy();
  tree.prune();
  write(tree, target);
  result.points = points;
  result.files = 1;
  result.bytes = std::filesystem::file_size(target);
  result.counts = {{"leaves", tree.getNumLeafNodes()}};
  return result;
}

}  // namespace stillmap::mapping
