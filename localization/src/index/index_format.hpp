#pragma once

#include <stillmap/maps/section_file.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

/// The files of an index: one for each region, and a root that tells which there are. Each is a
/// maps::SectionTable.
namespace stillmap::localization::index_format {

/// Counts up whenever a reader, or the same map's voxels, would differ.
/// IndexFile.HoldsTheBytesOfItsFormatNumber pins it and the bytes.
inline constexpr std::uint32_t kFormat = 3;
inline constexpr std::uint32_t kAlignment = 64;
inline constexpr maps::SectionFormat kRegionFile = {
    {'s', 't', 'i', 'l', 'l', 'i', 'd', 'x'}, kFormat, kAlignment, "a region of a map index"};
inline constexpr maps::SectionFormat kRootFile = {
    {'s', 't', 'i', 'l', 'l', 'i', 'd', 'r'}, kFormat, kAlignment, "the root of a map index"};

/// In the header of either file, whose count is that of the levels.
struct About {
  /// What it is made from (hex): of a region the digest of its tiles, of the root the map's; zeros
  /// for bare points.
  std::array<char, 64> source{};
  double finest_voxel_m = 0.0;
  std::uint32_t min_points = 0;
  /// Of a region: where its heights begin, above the index's origin, in units of 640 m.
  std::int32_t floor = 0;
  /// Of the root: box around the map's points, relative to the index's origin [m].
  std::array<double, 3> min_m{}, max_m{};
};
static_assert(sizeof(About) == 128);

/// What a section holds, as an array of one type; of a region its part is a level, 0 the coarsest.
enum class Kind : std::uint32_t {
  kTiles = 1,   ///< CellBlocks::Tile
  kSlots = 2,   ///< CellBlocks::Slot
  kVoxels = 3,  ///< Voxel
  /// 32-bit and 64-bit words of `CellBitsTable`; the part counts `kPlaceGridEdgesM`.
  kGridTiles = 4,
  kGridWords = 5,
  // Of the root.
  kRegions = 6,  ///< RegionRow
  kPlaces = 7,   ///< PlaceRow
  kMount = 8,    ///< double: 9 of a rotation, column by column
  kErrors = 9,   ///< OwnErrorColumn
  kViews = 10,   ///< PlaceView, one a place
};

}  // namespace stillmap::localization::index_format
