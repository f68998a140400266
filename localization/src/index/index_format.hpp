#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

/// The index file as it lies on the disk: header, section table, sections; little endian, without
/// pointers, every section at a multiple of 64 bytes, zeros between them.
namespace stillmap::localization::index_format {

static_assert(std::endian::native == std::endian::little, "the index is little endian as it lies");

inline constexpr std::array<char, 8> kMagic = {'s', 't', 'i', 'l', 'l', 'i', 'd', 'x'};
/// Counts up whenever a reader, or the same map's voxels, would differ: what lies in files of
/// another number is made anew. IndexFile.HoldsTheBytesOfItsFormatNumber pins both.
inline constexpr std::uint32_t kFormat = 1;
inline constexpr std::size_t kAlignment = 64;

struct Header {
  std::array<char, 8> magic = kMagic;
  std::uint32_t format = kFormat;
  std::uint32_t sections = 0;
  std::uint64_t file_bytes = 0;
  /// CRC-32C of header and section table, this field taken as 0.
  std::uint32_t crc = 0;
  std::uint32_t levels = 0;
  /// Content digest of the map (hex), zeros for bare points.
  std::array<char, 64> map_digest{};
  double finest_voxel_m = 0.0;
  std::uint32_t min_points = 0;
  std::uint32_t unused = 0;
  /// As `MapIndex::origin()` and `extent()`.
  std::array<double, 3> origin_m{}, extent_m{};
  std::array<std::byte, 32> padding{};
};
static_assert(sizeof(Header) == 192 && sizeof(Header) % kAlignment == 0);

/// What a section holds, as an array of one type.
enum class Kind : std::uint32_t {
  kTiles = 1,   ///< CellBlocks::Tile
  kSlots = 2,   ///< CellBlocks::Slot
  kVoxels = 3,  ///< Voxel
  /// 32-bit and 64-bit words of `CellBitsTable`; the level counts `kPlaceGrids`.
  kGridTiles = 4,
  kGridWords = 5,
};

struct Section {
  Kind kind{};
  /// 0 is the coarsest level.
  std::uint32_t level = 0;
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
  /// Of one item.
  std::uint32_t item_bytes = 0;
  /// CRC-32C of the section.
  std::uint32_t crc = 0;
};
static_assert(sizeof(Section) == 32);

}  // namespace stillmap::localization::index_format
