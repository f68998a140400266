#pragma once

#include "build/scan_stack.hpp"

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstdint>
#include <filesystem>

namespace stillmap::mapping {

/// What a map was made of and how.
struct BuildInputs {
  const std::filesystem::path& folder;
  const maps::Drive& drive;
  const MapBuildOptions& options;
};

/// Writes tiles, preview, trajectory, objects and the checksums of the scans.
/// @param stack  with at least one point.
/// @return points of the map. @throws maps::StorageError.
std::uint64_t write_contents(maps::MapPackageWriter& writer, const ScanStack& stack);

/// What the digest covers, without tiles and files: nothing of time, host or threads is in it.
[[nodiscard]] maps::MapManifest manifest_of(const BuildInputs& inputs,
                                            const Eigen::Vector3d& origin,
                                            const MapBuildReport& report);

}  // namespace stillmap::mapping
