#pragma once

#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// A format that maps are written in for other programs.
struct MapExportFormat {
  /// As people name it, such as `3dtiles`.
  std::string_view name;
  /// What comes out, in a line.
  std::string_view description;
};
/// All there are, in the order in which they are listed.
[[nodiscard]] std::vector<MapExportFormat> map_export_formats();

struct MapExportOptions {
  /// Kinds of points that are left out, such as those that were projected.
  std::set<PointKind> without{};
  DerivedWork work{};
};

/// What was written.
struct MapExportReport {
  /// Of the map's own points; copies on coarser levels do not count.
  std::uint64_t points = 0;
  std::uint64_t files = 0;
  std::uint64_t bytes = 0;
};

/// Writes a map for other programs; nothing is visible at `out` before all of it is there.
/// @param format  a name of `map_export_formats`.
/// @param out     must not exist.
/// @throws std::invalid_argument for an unknown format, InputError when `out` exists or no point is
/// left, StorageError, WorkStopped.
MapExportReport export_map(const MapPackage& map, std::string_view format,
                           const std::filesystem::path& out, const MapExportOptions& options = {});

}  // namespace stillmap::maps
