#pragma once

#include <stillmap/maps/map_export.hpp>

#include <array>
#include <filesystem>
#include <functional>
#include <vector>

namespace stillmap::maps {

/// One export while it runs.
struct ExportJob {
  const MapPackage& map;
  const MapExportOptions& options;
  /// `options.frame`, or the format's own choice.
  ExportFrame frame;
  /// File or empty folder to write.
  std::filesystem::path target;
  MapExportResult& result;

  [[nodiscard]] bool takes(PointKind kind) const { return !options.without.contains(kind); }
  /// @param stage  shares of the whole work that it begins and ends at. @throws WorkStopped.
  void tell(const std::array<double, 2>& stage, std::size_t done, std::size_t total) const {
    const double share = static_cast<double>(done) / static_cast<double>(total);
    if (options.work.go_on && !options.work.go_on(stage[0] + share * (stage[1] - stage[0])))
      throw WorkStopped();
  }
};

// One a format.
void export_pcd(ExportJob& job);
void export_ply(ExportJob& job);
void export_las(ExportJob& job);
void export_autoware(ExportJob& job);
void export_nav2(ExportJob& job);
void export_kitti(ExportJob& job);
void export_tum(ExportJob& job);
void export_simplemap(ExportJob& job);
void export_tiles3d(ExportJob& job);

/// Tiles of points; coarser levels are left out.
[[nodiscard]] std::vector<TileEntry> point_tiles(const MapPackage& map);

/// Counts what is chosen into the report. @return how many points that are.
/// @throws InputError when there are none.
std::uint64_t count_chosen(ExportJob& job);

/// Hands on the chosen points of each tile, in the tiles' order.
void visit_chosen(const ExportJob& job,
                  const std::function<void(const MapTile&, const MapPoint&)>& visit);

}  // namespace stillmap::maps
