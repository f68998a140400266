#pragma once

#include "cell_bits.hpp"
#include "cell_blocks.hpp"
#include "own_error.hpp"
#include "place_view.hpp"
#include "voxel_runs.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/region.hpp>
#include <stillmap/maps/section_file.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace stillmap::localization {

/// What a file of an index is made from; another one of the same key has the same bytes.
struct IndexKey {
  /// 64 hex digits (`index_format::About::source`); empty for bare points.
  std::string source;
  MapIndexOptions options;
};

using maps::CacheLine;

/// One level of a region as it is built.
struct VoxelLevel {
  CellBlockTable cells;
  /// CRC-32C of its voxels.
  std::uint32_t voxels_crc = 0;
};

/// A region as it is built.
struct RegionContent {
  /// Heights count from here, above the index's origin, in units of `kRegionM`.
  std::int32_t floor = 0;
  /// Coarse to fine, as many as the options say.
  std::vector<VoxelLevel> levels;
  /// As many as `kPlaceGridEdgesM`.
  std::vector<CellBitsTable> place_grids;
  VoxelRuns voxels;
};

/// Views into the bytes of a region's file. Coordinates count from the region's corner and floor.
struct RegionView {
  std::int32_t floor = 0;
  /// Coarse to fine.
  std::vector<CellBlocks::Part> levels;
  std::vector<CellBits::Part> place_grids;
};

/// @param content  outlives the result.
[[nodiscard]] maps::SectionFile sections_of(const IndexKey& key, const RegionContent& content);

/// Checks header, section table and tile directories, and touches nothing else: whatever the other
/// sections hold, looking something up in the view stays inside the bytes.
/// @param bytes  aligned to 64. @param name  of the file, for the error.
/// @throws maps::InputError when they are no region, broken, of another format, or of another key.
[[nodiscard]] RegionView region_view(std::span<const std::byte> bytes, const IndexKey& key,
                                     const std::string& name);

/// Reads every section. @throws maps::InputError naming the first broken one.
void verify_region(std::span<const std::byte> bytes, const std::string& name);

/// A region that the index has.
struct RegionRow {
  maps::RegionId id;
  /// Of all levels, and of the finest.
  std::uint64_t voxels = 0, finest_voxels = 0;
  /// As in the key of its file.
  std::array<char, 64> source{};
};
static_assert(sizeof(RegionRow) == 88);

/// Where a scan may be looked for: an upright frame, mount and heading taken out.
struct PlaceRow {
  maps::RegionId region;
  /// Columns of the rotation, one behind the other.
  std::array<float, 9> R_map_place;
  /// x, y from the region's corner, z above the index's origin [m].
  std::array<float, 3> place_m;
};
static_assert(sizeof(PlaceRow) == 56);

/// What is known of the map as a whole.
struct RootContent {
  /// Around the map's points, relative to the index's origin [m].
  Eigen::AlignedBox3d bounds;
  /// By x, then y; at least one.
  std::vector<RegionRow> regions;
  /// By region, in the order of `regions`.
  std::vector<PlaceRow> places;
  /// What stands around each place.
  std::vector<PlaceView> views;
  /// Of the scans that the places were seen from.
  Eigen::Matrix3d R_level_lidar = Eigen::Matrix3d::Identity();
  /// By x, then y.
  std::vector<OwnErrorColumn> own_errors;
};

/// @param content  outlives the result.
[[nodiscard]] maps::SectionFile sections_of(const IndexKey& key, const RootContent& content);

/// Views into the bytes of a root.
struct RootView {
  Eigen::AlignedBox3d bounds;
  std::span<const RegionRow> regions;
  std::span<const PlaceRow> places;
  /// As many as places.
  std::span<const PlaceView> views;
  Eigen::Matrix3d R_level_lidar = Eigen::Matrix3d::Identity();
  std::span<const OwnErrorColumn> own_errors;
};

/// Checks all of it but the places, views and errors, which are read when they are asked for.
/// @throws as `region_view`.
[[nodiscard]] RootView root_view(std::span<const std::byte> bytes, const IndexKey& key,
                                 const std::string& name);

/// As `verify_region`.
void verify_root(std::span<const std::byte> bytes, const std::string& name);

}  // namespace stillmap::localization
