#pragma once

#include <stillmap/maps/map_export.hpp>

#include <filesystem>

namespace stillmap::maps {

/// Writers of `map_export.cpp`'s table, a file each. All do what `export_map` says.

/// A folder: `tileset.json` and `LEVEL/X/Y.glb` (3D Tiles 1.1). On the Earth (ECEF) when the map
/// knows its geodetic origin, else in map coordinates.
MapExportReport export_tiles3d(const MapPackage& map, const std::filesystem::path& out,
                               const MapExportOptions& options);

}  // namespace stillmap::maps
