#include <stillmap/maps/error.hpp>
#include <stillmap/maps/tile_check.hpp>

#include <span>
#include <stdexcept>
#include <string>

#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/sha256.hpp>

namespace stillmap::maps {

void require_whole_tile(const MapPackage& map, TileId id) {
  const std::span<const std::byte> bytes = map.stored_tile(id);
  if (bytes.empty()) throw std::invalid_argument(tile_path(id) + ": no tile of the package");
  Sha256 hash;
  hash.add(bytes.data(), bytes.size());
  const std::string found = hash.hex();
  const auto [stated, file] = map.stored_name(id);
  if (found != stated)
    throw InputError(file, "SHA-256 " + found,
                     stated + " as the package states it: copy or build the map again");
}

void require_whole_tiles(const MapPackage& map, const DerivedWork& work) {
  for (const TileEntry& tile : map.tiles()) {
    if (tile.id.level != 0) continue;
    if (work.go_on && !work.go_on(0.0)) throw WorkStopped();
    require_whole_tile(map, tile.id);
  }
}

}  // namespace stillmap::maps
