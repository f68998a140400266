#pragma once

#include "ground/ground_cells.hpp"
#include "ground/ground_sheets.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/scratch_vector.hpp>

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace stillmap::mapping {

/// What the scans say about one cell: the heaviest layer of heights, and the runner-up.
struct GroundCellSum {
  float z = 0.0F;
  float weight = 0.0F;
  /// Where the mean lies from the cell's centre [m].
  float offset_x = 0.0F;
  float offset_y = 0.0F;
  /// Share of `weight` measured outside of boxes, as a weight.
  float trusted = 0.0F;
  float other_z = 0.0F;
  float other_weight = 0.0F;
  float other_trusted = 0.0F;

  /// Merges a scan's layer: into the layer it is within 8 cm of, else into a runner-up, which wears
  /// off as others disagree with it (Misra and Gries, "Finding repeated elements", 1982).
  void add(const GroundCells::Cell& cell);
};

/// The cells of one block around one height; see `GroundPiles`.
struct GroundPile {
  std::int32_t block_x = 0;
  std::int32_t block_y = 0;
  /// What came first decides what else belongs here: within 2 m.
  float anchor_z = 0.0F;
  std::array<GroundCellSum, GroundSheets::kNodes> cells{};
};

/// Gathers the ground of scans, in their order.
class GroundPiles {
 public:
  /// @param scratch  as of `maps::ScratchPieces`.
  explicit GroundPiles(const std::filesystem::path& scratch) : piles_(scratch) {}

  void add(const GroundCells& ground);
  /// Gives memory back; what is added to next comes from the file.
  void rest() const { piles_.rest(); }

  /// The piles, and of these, by number, those that are a sheet: piles of a block that fill each
  /// other's gaps are joined into one (a wall between two yards), those that lie over each other
  /// stay apart (a bridge). A small one over or under a heavier one is dropped (a mirror image).
  struct Sheets {
    maps::ScratchVector<GroundPile> piles;
    std::vector<std::uint32_t> numbers;
  };
  [[nodiscard]] Sheets take_sheets() &&;

 private:
  GroundPile& pile_for(std::int32_t block_x, std::int32_t block_y, float z);

  maps::ScratchVector<GroundPile> piles_;
  std::vector<std::uint32_t> next_;
  maps::CellMap<std::uint32_t> first_;
  /// Of blocks, in the order that they came in.
  std::vector<std::uint32_t> blocks_;
};

}  // namespace stillmap::mapping
