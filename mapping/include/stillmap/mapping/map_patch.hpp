#pragma once

#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>

namespace stillmap::mapping {

struct PatchOptions {
  /// What a drive's surfaces may be off from the map's where both have some, for sure [m], in
  /// [0.005, 0.2].
  double most_seam_m = 0.02;
  /// Of the places (1 m by 1 m) of a tile where the map has something, the share that a drive must
  /// have seen for the tile to be new, in (0, 1].
  double least_seen = 0.25;
  /// In [0, 256], 0 = all cores.
  int threads = 0;

  [[nodiscard]] std::vector<std::string> violations() const;
};

struct PatchResult {
  std::string digest;
  /// Tiles that are new or changed, and those that are the ones of the version before.
  std::uint64_t tiles_new = 0, tiles_kept = 0;
  std::uint64_t regions_new = 0, regions_kept = 0;
  /// In new tiles: points of the version before that stayed, that gave way to a new one at their
  /// place, and that stood where the drives saw free space; and points of the drives.
  std::uint64_t points_kept = 0, points_replaced = 0, points_gone = 0, points_added = 0;
  /// Quarters of tiles whose surfaces were compared; the largest difference that is sure (by three
  /// deviations) and that a second one within 30 m confirms [m], and where it is in the map frame
  /// [m].
  std::uint64_t seams = 0;
  double worst_seam_m = 0.0;
  Eigen::Vector3d worst_seam_at_map = Eigen::Vector3d::Zero();
  /// Of files that the version before does not have.
  std::uint64_t bytes_new = 0, bytes = 0;
};

/// The tiles of a map that a drive has seen enough of to make them new, and those where the map has
/// nothing yet. @param drive  a map of the drive alone, in the other's frame.
/// @throws maps::InputError.
[[nodiscard]] std::set<maps::TileId> tiles_to_patch(const maps::MapPackage& previous,
                                                    const maps::MapPackage& drive,
                                                    const PatchOptions& options);

/// A version of a map in which only the tiles that new drives saw are new (mapping/patches.md).
/// Everything else is the same, byte for byte, and takes no room where the file system has hard
/// links. The drives are added to those of the map: objects, poses and graph, too.
///
/// Same input, same bytes for any number of threads. Time and memory grow with the new drives, but
/// for the graph, the list of sources and the preview, which are of the whole map.
/// @param drive  a map of the new drives alone, built registered to `previous` with
/// `MapBuildOptions::follows_map`.
/// @throws std::invalid_argument (options), maps::InputError for maps that do not go together, or
/// whose surfaces are apart by more than `most_seam_m`, with the place; maps::StorageError,
/// Cancelled.
PatchResult patch_map(const maps::MapPackage& previous, const maps::MapPackage& drive,
                      const std::filesystem::path& target, const PatchOptions& options,
                      const ProgressCallback& progress, const CancelFlag& cancel);

/// The object `patch` of a rebuild's report and of a patched package's build.json; keys as in
/// mapping/patches.md.
[[nodiscard]] std::string to_json(const PatchResult& result);
/// Reads it back. @throws std::invalid_argument for another text.
[[nodiscard]] PatchResult patch_result_from(const std::string& json);

}  // namespace stillmap::mapping
