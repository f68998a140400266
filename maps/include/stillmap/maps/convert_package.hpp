#pragma once

#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstdint>
#include <filesystem>
#include <string>

namespace stillmap::maps {

/// Writes a package of schema 1 as one of schema 2. Each coordinate is put in steps as a build does
/// it (`tile_steps.hpp`): it is off by at most a step and stays in its tile and voxel. Intensities
/// keep 11 bits. All else stays as it was: origin, tiles, counts, histories, objects, trajectories,
/// and every other file that the manifest lists. Tiles of a level above 0 stay behind: they hold
/// points of level 0 again, thinned. What was written is read again and compared with the package,
/// point by point. Equal packages give equal bytes.
/// @param target  as that of `MapPackageWriter`.
/// @param work    one thread is used.
/// @return the digest of the new package.
/// @throws InputError naming the file that is damaged, or what schema 2 has no place for: a point
/// outside its tile, a number that is not finite, a scan of no drive; WorkStopped; StorageError.
/// Nothing is left then.
std::string convert_package(const MapPackage& map, const std::filesystem::path& target,
                            const DerivedWork& work = {});

/// Bytes that `convert_package` needs: those of the new package at most, and what it takes beside
/// them while it writes.
struct ConversionRoom {
  std::uint64_t package_bytes = 0;
  std::uint64_t beside_bytes = 0;
};
/// An estimate from above: 32 bytes a point where 19 are usual, and 20 where 11 are, without
/// histories.
[[nodiscard]] ConversionRoom conversion_room(const MapManifest& manifest);

}  // namespace stillmap::maps
