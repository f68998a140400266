#pragma once

#include <stillmap/maps/map_package.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

inline constexpr const char* kManifestName = "manifest.json";
inline constexpr const char* kBuildName = "build.json";
inline constexpr const char* kGraphName = "graph.json";
/// 12 numbers a line, 3x4 row-major.
inline constexpr const char* kPlacesName = "places.txt";

/// `tiles/<level>_<x>_<y>.bin`
[[nodiscard]] std::string tile_path(TileId id);
/// `tiles/<level>_<x>_<y>.history`
[[nodiscard]] std::string history_path(TileId id);
/// Files of a drive: `trajectory.tum`, `trajectory_2.tum`, ... @param drive  from 0.
[[nodiscard]] std::string trajectory_path(std::size_t drive);
[[nodiscard]] std::string objects_path(std::size_t drive);
[[nodiscard]] std::string fates_path(std::size_t drive);
[[nodiscard]] std::string disagreement_path(std::size_t drive);

/// Canonical text: keys sorted, shortest digits that read back the same number, nothing of time or
/// host. Equal manifests give equal bytes.
[[nodiscard]] std::string manifest_text(const MapManifest& manifest);

/// Reads it back, every type, range and path checked. @param file  for messages.
/// @throws InputError naming file, key, value and what was expected; for a newer schema, the
/// schema.
[[nodiscard]] MapManifest parse_manifest(std::string_view text, const std::string& file);

}  // namespace stillmap::maps
