#pragma once

#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/section_file.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace stillmap::maps {

/// One tile of a `TileFile`, as it lies in the file's table (little endian, 96 bytes).
struct TileRow {
  /// `TileId`: of which of the file's groups (level, side of a difference), and where.
  std::uint32_t group = 0;
  std::int32_t x = 0;
  std::int32_t y = 0;
  /// CRC-32C of the points.
  std::uint32_t crc = 0;
  std::uint64_t offset = 0;
  std::uint64_t points = 0;
  /// True bounds of the points, from the tile's corner [m].
  std::array<float, 3> min{}, max{};
  /// Points of each `PointKind`; of a kind that this version does not know, none.
  std::array<std::uint64_t, 4> kinds{};
  /// Ground squares of 1 m x 1 m that hold a point.
  std::uint32_t squares = 0;
  /// Of a difference: points at places that the other version saw free.
  std::uint32_t seen_free = 0;

  [[nodiscard]] TileId id() const { return {.level = group, .x = x, .y = y}; }
  /// @param tile  that the row is of.
  [[nodiscard]] TileEntry entry(TileId tile) const {
    TileEntry entry{.id = tile, .points = points};
    const Eigen::Vector3d corner = corner_of(tile);
    for (std::size_t axis = 0; axis < min.size(); ++axis) {
      entry.min[axis] = corner[static_cast<Eigen::Index>(axis)] + min[axis];
      entry.max[axis] = corner[static_cast<Eigen::Index>(axis)] + max[axis];
    }
    return entry;
  }
};
static_assert(sizeof(TileRow) == 96 && std::is_trivially_copyable_v<TileRow>);

/// Writes tiles of points one after the other; what was written can be read again, so that one
/// level is made from the one below. Memory: the table.
class TileFileWriter {
 public:
  /// @param key  what the file is made from, at most 1 KiB; a reader asks for the same.
  /// @throws StorageError as `DerivedFile`, as all that follow.
  TileFileWriter(const std::filesystem::path& file, std::string key);

  /// @param id  after the ones before (by `TileId`'s order). @param points  from the tile's corner,
  /// at least one, finite.
  void add(TileId id, std::span<const MapPoint> points, std::uint32_t seen_free = 0);
  [[nodiscard]] const std::vector<TileRow>& rows() const { return rows_; }
  /// Safe from several threads while nothing is added.
  [[nodiscard]] std::vector<MapPoint> read(const TileRow& row) const;
  /// Once only, and last.
  void publish();

 private:
  DerivedFile file_;
  std::string key_;
  std::vector<TileRow> rows_;
  std::uint32_t points_crc_ = 0;
};

/// Reads such a file. Immutable, safe from several threads. Open it stays readable when it is
/// replaced or removed.
class TileFile {
 public:
  /// Checks header and table. @throws StorageError when it cannot be read; InputError naming the
  /// file when it is damaged, of another format or of another key.
  TileFile(std::filesystem::path file, const std::string& key);
  ~TileFile();
  TileFile(const TileFile&) = delete;
  TileFile& operator=(const TileFile&) = delete;

  /// Sorted by id.
  [[nodiscard]] const std::vector<TileRow>& rows() const { return rows_; }
  /// Null when there is none.
  [[nodiscard]] const TileRow* find(TileId id) const;
  /// @throws InputError when the points do not fit their checksum, StorageError.
  [[nodiscard]] std::vector<MapPoint> read(const TileRow& row) const;

 private:
  void read_all(std::uint64_t offset, std::span<std::byte> to) const;
  void read_section(const Section& section, std::span<std::byte> to) const;
  void load(const std::string& key);

  std::filesystem::path file_;
  int descriptor_ = -1;
  std::vector<TileRow> rows_;
};

}  // namespace stillmap::maps
