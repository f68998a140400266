#pragma once

#include "ground/ground_piles.hpp"
#include "ground/ground_sheets.hpp"

#include <Eigen/Core>

#include <vector>

namespace stillmap::mapping {

/// The sheets with what was measured in them: piles and sheets of the same numbers first, then
/// the empty sheets around them.
struct MeasuredSheets {
  GroundSheets sheets;
  std::vector<GroundPile> piles;
  /// One a sheet: how the street rises there, whatever steps cross it.
  std::vector<Eigen::Vector2f> slopes;
};

/// How sure a height of that weight is, see `GroundNode`.
[[nodiscard]] std::uint8_t ground_confidence_255(float weight);

/// Sheets of the piles, joined to their neighbours, with a slope each.
[[nodiscard]] MeasuredSheets sheets_of(std::vector<GroundPile> piles);

/// Takes away islands: less than 3 m^2 of cells joined without a step, which stand more than 0.2 m
/// above or below larger ground within 1 m. A bonnet or a mirror image that was labelled ground;
/// where such a cell holds a second layer that fits the ground around, that one is taken.
void drop_islands(MeasuredSheets& ground);

/// Gives each measured cell a plane: the weighted one through the cells within 0.5 m that lie on no
/// other side of a step. A kerb parts cells: what differs from the street's slope by more than
/// 4 cm + 0.1 d at distance d has no say.
void smooth_measured(MeasuredSheets& ground);

}  // namespace stillmap::mapping
