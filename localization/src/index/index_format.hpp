#pragma once

#include <stillmap/maps/section_file.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

/// The index file: a maps::SectionTable whose header counts the levels, and its sections.
namespace stillmap::localization::index_format {

/// Counts up whenever a reader, or the same map's voxels, would differ.
/// IndexFile.HoldsTheBytesOfItsFormatNumber pins it and the bytes.
inline constexpr std::uint32_t kFormat = 1;
inline constexpr std::uint32_t kAlignment = 64;
inline constexpr maps::SectionFormat kIndex = {
    {'s', 't', 'i', 'l', 'l', 'i', 'd', 'x'}, kFormat, kAlignment, "a map index"};

/// In the header.
struct About {
  /// Content digest of the map (hex), zeros for bare points.
  std::array<char, 64> map_digest{};
  double finest_voxel_m = 0.0;
  std::uint32_t min_points = 0;
  std::uint32_t unused = 0;
  /// As `MapIndex::origin()` and `extent()`.
  std::array<double, 3> origin_m{}, extent_m{};
};
static_assert(sizeof(About) == 128);

/// What a section holds, as an array of one type; its part is a level, 0 the coarsest.
enum class Kind : std::uint32_t {
  kTiles = 1,   ///< CellBlocks::Tile
  kSlots = 2,   ///< CellBlocks::Slot
  kVoxels = 3,  ///< Voxel
  /// 32-bit and 64-bit words of `CellBitsTable`; the part counts `kPlaceGrids`.
  kGridTiles = 4,
  kGridWords = 5,
};

}  // namespace stillmap::localization::index_format
