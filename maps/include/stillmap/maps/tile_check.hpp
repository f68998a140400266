#pragma once

#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/map_package.hpp>

namespace stillmap::maps {

/// Compares the bytes of a tile as they lie now with the checksum that the manifest has of them;
/// opening a package looks at sizes alone. Some half a millisecond a megabyte.
/// @throws InputError naming the file when they differ; std::invalid_argument for a tile that the
/// package does not have.
void require_whole_tile(const MapPackage& map, TileId id);

/// The same for every tile of level 0, so that nothing is derived from bytes that were damaged.
/// @param work  told the share 0 now and then. @throws also WorkStopped.
void require_whole_tiles(const MapPackage& map, const DerivedWork& work = {});

}  // namespace stillmap::maps
