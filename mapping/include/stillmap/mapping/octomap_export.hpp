#pragma once

#include <stillmap/maps/map_export.hpp>

#include <filesystem>

namespace stillmap::mapping {

/// What `maps::check_export_options` needs of the format `octomap`, which is not one of `maps`
/// since it takes liboctomap to write it.
[[nodiscard]] const maps::MapExportFormat& octomap_format();

/// Writes the chosen points of a map as occupied leaves of an OcTree (`.bt`); free space is left
/// out. Some 40 bytes of memory a leaf.
/// @throws as `maps::export_map`; InputError for a map that reaches beyond the tree (32768 leaves
/// from zero) or fills more than 50 million leaves.
maps::MapExportResult export_octomap(const maps::MapPackage& map,
                                     const std::filesystem::path& target,
                                     const maps::MapExportOptions& options);

}  // namespace stillmap::mapping
