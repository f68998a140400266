#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/geodesy.hpp>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::maps {

/// A point cloud map as Autoware keeps it.
struct AutowareMap {
  /// Sorted by name.
  std::vector<std::filesystem::path> clouds;
  /// As the file names it, such as `LocalCartesianUTM`; empty without a file.
  std::string projector;
  /// Of `map_origin`, or the square's name: for people.
  std::string place_text;
  /// LocalCartesian: where the coordinates' zero lies. Of the others the place that a map's frame
  /// may have: `map_origin`. Nothing for MGRS and Local.
  std::optional<GeodeticOrigin> origin;
  /// The grid of the coordinates; nothing for LocalCartesian and Local.
  std::optional<MercatorGrid> grid;
  /// What heights are above, where that is not the ellipsoid: `EGM2008`.
  std::string heights;
  std::vector<std::string> notes;
};

/// Whether a folder is such a map: `pointcloud_map.pcd` (a file, or a folder of tiles) or
/// `pointcloud_map_metadata.yaml` is in it, or it is `pointcloud_map.pcd` itself (as a file with
/// `map_projector_info.yaml` beside it).
[[nodiscard]] bool is_autoware_map(const std::filesystem::path& folder);

/// Reads which clouds belong to it, from `pointcloud_map_metadata.yaml` where there is one, and
/// what their coordinates are, from `map_projector_info.yaml`: of type Local, LocalCartesian,
/// LocalCartesianUTM, MGRS or TransverseMercator. Without that file the coordinates are local.
/// The altitude of `map_origin` counts as 0 whatever is written, as Autoware's loader takes it; a
/// note says so.
/// Source: https://github.com/autowarefoundation/autoware_core,
/// map/autoware_map_projection_loader/README.md and map/autoware_map_loader/README.md.
/// @throws InputError naming file and value: no cloud, a tile that is missing, an unknown
/// projector, a place that is none; StorageError.
[[nodiscard]] AutowareMap read_autoware_map(const std::filesystem::path& folder);

}  // namespace stillmap::maps
