#pragma once

#include "cell_bits.hpp"

#include <stillmap/maps/section_file.hpp>
#include "map_level.hpp"

#include <stillmap/localization/map_index.hpp>

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace stillmap::localization {

/// What an index is made from; another one of the same key has the same bytes.
struct IndexKey {
  /// Content digest of the map, 64 hex digits; empty for bare points.
  std::string map_digest;
  MapIndexOptions options;
};

/// One level as it is built.
struct VoxelLevel {
  CellBlockTable cells;
  std::vector<Voxel> voxels;
};

struct IndexContent {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d extent = Eigen::Vector3d::Zero();
  /// Coarse to fine, as many as the options say.
  std::vector<VoxelLevel> levels;
  /// As many as `kPlaceGrids`.
  std::vector<CellBitsTable> place_grids;
};

using maps::CacheLine;

/// The file's bytes, from the beginning to a multiple of 64.
[[nodiscard]] std::vector<CacheLine> to_bytes(const IndexKey& key, const IndexContent& content);

/// Views into the bytes of an index.
struct IndexView {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d extent = Eigen::Vector3d::Zero();
  std::vector<MapIndex::Level> levels;
  std::vector<CellBits> place_grids;
};

/// Checks header, section table and tile directories, and touches nothing else: whatever the other
/// sections hold, looking something up in the view stays inside the bytes.
/// @param bytes  aligned to 64. @param name  of the file, for the error.
/// @throws maps::InputError when they are no index, broken, of another format, or of another key.
[[nodiscard]] IndexView view_of(std::span<const std::byte> bytes, const IndexKey& key,
                                const std::string& name);

/// Reads every section that `view_of` took. @throws maps::InputError naming the first broken one.
void verify_sections(std::span<const std::byte> bytes, const std::string& name);

}  // namespace stillmap::localization
