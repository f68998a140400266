#pragma once

#include "ground/cell_points.hpp"
#include "ground/ground_likelihood.hpp"
#include "ground/height_grid.hpp"

#include <vector>

namespace stillmap::mapping {

/// The patches of one scan: plane and verdict of each patch of the zone model.
struct Patches {
  std::vector<PlaneFit> planes;
  std::vector<PatchVerdict> verdicts;
};

/// Ground heights of 1 m cells from patches, each checked against the ground around it.
///
/// Cells are visited from near to far. The plane of a patch that is ground, and the ground already
/// found around a cell (local plane with a prior on its slope), predict its height; it is ground
/// when points lie near that. Where something stands in the cell, they may be only little above the
/// prediction. Cells that disagree with all their neighbours are taken back.
/// @param points  levelled.
void grow_ground(const CellPoints& points, const Patches& patches, HeightGrid& grid);

}  // namespace stillmap::mapping
