#pragma once

#include <stillmap/maps/tile_layer.hpp>

#include <filesystem>
#include <string>

namespace stillmap::maps {

/// Keeps a layer of a map in a file: header, tiles, bands; little endian, under a checksum.
/// @param digest  of the map. @throws StorageError, also while another one writes it.
void write_layer(const std::filesystem::path& file, const std::string& digest,
                 const TileLayer& layer);

/// @param digest  of the map that it must be of.
/// @throws StorageError when there is none, InputError naming the file when it is broken, cut, of
/// another format or of another map.
[[nodiscard]] TileLayer read_layer(const std::filesystem::path& file, const std::string& digest);

}  // namespace stillmap::maps
