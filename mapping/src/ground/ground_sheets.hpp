#pragma once

#include "ground/ground_cells.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/scratch_vector.hpp>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// How a cell's height is known.
enum class GroundState : std::uint8_t {
  kUnknown = 0,
  kFilled = 1,   ///< from the cells around
  kSuspect = 2,  ///< measured, but only inside of boxes: ground under a car, or its underside
  kKnown = 3,    ///< measured
};

/// A cell of a finished ground: a small plane through `z` at the cell's centre.
struct GroundNode {
  float z = 0.0F;
  float slope_x = 0.0F;
  float slope_y = 0.0F;
  /// Of what was measured: 1 = often and from near.
  std::uint8_t confidence_255 = 0;
  GroundState state = GroundState::kUnknown;
  /// Cells to the nearest measured one, 0 = measured.
  std::uint8_t reach = 0;

  [[nodiscard]] bool measured() const { return state >= GroundState::kSuspect; }
};

/// The fused ground as blocks of 16 x 16 nodes. Where one road lies above another a block has
/// several sheets, each joined to its own neighbours.
class GroundSheets {
 public:
  static constexpr int kSide = kGroundBlockCells;
  static constexpr int kNodes = kSide * kSide;
  static constexpr std::uint32_t kNone = 0xFFFFFFFFU;

  struct Sheet {
    std::int32_t block_x = 0;
    std::int32_t block_y = 0;
    /// Mean height of what was measured [m]; of a sheet without, that of its neighbour.
    float mean_z = 0.0F;
    /// Sum of the weights of what was measured.
    float weight = 0.0F;
    /// Sheets around it, row by row from (-1, -1); its own number in the middle.
    std::array<std::uint32_t, 9> around{};
    std::array<GroundNode, kNodes> nodes{};
  };

  /// A node and the sheet it belongs to.
  struct Place {
    std::uint32_t sheet = kNone;
    int node = 0;
  };

  /// @param scratch  as of `maps::ScratchPieces`.
  explicit GroundSheets(const std::filesystem::path& scratch) : sheets_(scratch) {}

  /// Gives memory back; what is looked at next comes from the file. Safe beside threads that read.
  void rest() const { sheets_.rest(); }

  /// @return the new sheet's number. Its neighbours are joined by `join`.
  std::uint32_t add(std::int32_t block_x, std::int32_t block_y);
  /// Adds an empty sheet beside every sheet that has none within 2 m of its height, so that the
  /// ground can spread there, and joins all sheets to their neighbours.
  void join();

  [[nodiscard]] std::size_t size() const { return sheets_.size(); }
  [[nodiscard]] Sheet& operator[](std::size_t sheet) { return sheets_[sheet]; }
  [[nodiscard]] const Sheet& operator[](std::size_t sheet) const { return sheets_[sheet]; }
  [[nodiscard]] GroundNode& node(Place place) {
    return sheets_[place.sheet].nodes[static_cast<std::size_t>(place.node)];
  }
  [[nodiscard]] const GroundNode& node(Place place) const {
    return sheets_[place.sheet].nodes[static_cast<std::size_t>(place.node)];
  }

  /// The place `x`, `y` cells from the corner of a sheet's block, in it or in a neighbour of it.
  /// @param x, y  in [-16, 32).
  [[nodiscard]] Place beside(std::uint32_t sheet, int x, int y) const {
    const int column = (x + kSide) / kSide;
    const int row = (y + kSide) / kSide;
    const std::uint32_t there = sheets_[sheet].around[static_cast<std::size_t>(3 * row + column)];
    return {there, (y + kSide) % kSide * kSide + (x + kSide) % kSide};
  }

  /// The sheet of a cell for someone at height `z`: the highest with a height there that is no
  /// more than half a metre above him, else the lowest. Without `z` the one with the most weight.
  [[nodiscard]] std::optional<Place> find(int cell_x, int cell_y, std::optional<double> z) const;

 private:
  [[nodiscard]] std::uint32_t nearest_in(std::int32_t block_x, std::int32_t block_y, float z) const;
  void join(std::uint32_t sheet);

  maps::ScratchVector<Sheet> sheets_;
  /// First sheet of each block; the others follow in `next_`.
  maps::CellMap<std::uint32_t> first_;
  std::vector<std::uint32_t> next_;
};

}  // namespace stillmap::mapping
