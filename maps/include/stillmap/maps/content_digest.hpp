#pragma once

#include <stillmap/maps/map_package.hpp>

#include <string>

namespace stillmap::maps {

/// SHA-256, as lower-case hex, of what a map holds: points, objects and poses as they are decoded.
/// Two maps have the same one when they hold the same, whatever their files, tiles, options,
/// sources, program and time of build are. maps/content_digest.md states every byte that enters.
///
/// For comparisons, not for trust: `MapPackage::digest` seals a package against changes on purpose.
/// @throws InputError for a broken file of the package.
[[nodiscard]] std::string content_digest(const MapPackage& map);

}  // namespace stillmap::maps
