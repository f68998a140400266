#pragma once

#include "ground/ground_piles.hpp"
#include "ground/ground_sheets.hpp"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace stillmap::mapping {

/// The sheets with what was measured in them: piles and sheets of the same numbers first, then
/// the empty sheets around them.
struct MeasuredSheets {
  GroundSheets sheets;
  GroundPiles::Sheets piles;
  /// One a sheet: how the street rises there, whatever steps cross it.
  std::vector<Eigen::Vector2f> slopes;
  /// As of `maps::ScratchPieces`, for what a step needs for each cell.
  std::filesystem::path scratch;

  /// Sheets that something was measured in.
  [[nodiscard]] std::uint32_t measured() const {
    return static_cast<std::uint32_t>(piles.numbers.size());
  }
  /// @param sheet  below `measured()`.
  [[nodiscard]] GroundPile& pile(std::uint32_t sheet) { return piles.piles[piles.numbers[sheet]]; }
  [[nodiscard]] const GroundPile& pile(std::uint32_t sheet) const {
    return piles.piles[piles.numbers[sheet]];
  }
  /// In each step of a pass: gives memory back now and then.
  void stepped(std::size_t step) const {
    if (!maps::rests_after(step)) return;
    sheets.rest();
    piles.piles.rest();
  }
};

/// How sure a height of that weight is, see `GroundNode`.
[[nodiscard]] std::uint8_t ground_confidence_255(float weight);

/// Sheets of the piles, joined to their neighbours, with a slope each.
/// @param scratch  as of `maps::ScratchPieces`.
[[nodiscard]] MeasuredSheets sheets_of(GroundPiles::Sheets piles,
                                       const std::filesystem::path& scratch);

/// Takes away islands: less than 3 m^2 of cells joined without a step, which stand more than 0.2 m
/// above or below larger ground within 1 m. A bonnet or a mirror image that was labelled ground;
/// where such a cell holds a second layer that fits the ground around, that one is taken.
void drop_islands(MeasuredSheets& ground);

/// Gives each measured cell a plane: the weighted one through the cells within 0.5 m that lie on no
/// other side of a step. A kerb parts cells: what differs from the street's slope by more than
/// 4 cm + 0.1 d at distance d has no say.
void smooth_measured(MeasuredSheets& ground);

}  // namespace stillmap::mapping
