#pragma once

#include "pipeline/build_journal.hpp"
#include "pipeline/scan_work.hpp"
#include "pipeline/tile_work.hpp"

#include <stillmap/maps/map_tile.hpp>

#include <cstddef>
#include <string>
#include <vector>

/// What a finish unit leaves to `merge`: first the scans that it answers for, then its tiles, last
/// how many there are.
namespace stillmap::mapping {

class FinishedWriter {
 public:
  explicit FinishedWriter(BuildJournal& journal) : journal_(journal) {}

  /// Before tiles, by ordinal. All but the voxels.
  void add(const PlacedScan& scan);
  /// In the order of `regions_of`.
  void add(const FinishedTile& tile);
  /// Completes the journal.
  void finish();

 private:
  BuildJournal& journal_;
  std::size_t scans_ = 0;
  std::vector<maps::TileId> tiles_;
};

class FinishedReader {
 public:
  /// @param journal  complete. @param grid  lives as long as this.
  /// @throws maps::InputError for broken records, as all below.
  FinishedReader(const BuildJournal& journal, const VoxelGrid& grid, std::string unit);

  [[nodiscard]] const std::vector<maps::TileId>& tiles() const { return tiles_; }
  /// The next one, in the order in which they were added. @param scan  its ordinal.
  [[nodiscard]] PlacedScan next_scan(std::size_t scan);
  /// @param tile  in [0, tiles().size()).
  [[nodiscard]] FinishedTile tile(std::size_t tile) const;

 private:
  template <typename Read>
  auto read(std::size_t record, const Read& read) const;

  const BuildJournal& journal_;
  const VoxelGrid& grid_;
  std::string unit_;
  std::size_t scans_ = 0;
  std::size_t next_ = 0;
  std::vector<maps::TileId> tiles_;
};

}  // namespace stillmap::mapping
