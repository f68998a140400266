#pragma once

#include "ground/cell_points.hpp"
#include "ground/ground_likelihood.hpp"
#include "ground/height_grid.hpp"

#include <vector>

namespace stillmap::mapping {

/// Plane and verdict of each patch of the zone model, in levelled coordinates.
struct Patches {
  std::vector<PlaneFit> planes;
  std::vector<PatchVerdict> verdicts;
};

/// Ground heights of 1 m cells from patches, each checked against the ground around it; ours, not
/// the paper's.
///
/// A patch is up to 10 m long and one plane; the lowest points of a patch without ground (a car's
/// underside, a flat roof, a hedge) make a plane too. So patches only propose: they start cells
/// near the sensor, and carry the ground over gaps where they agree with it. From there cells are
/// visited from near to far, each predicted from the ground already found around it, and are ground
/// when points lie near that. Cells that disagree with all their neighbours are taken back.
/// @param points          levelled.
/// @param plane_within_m  how far the plane under the sensor was looked for: a sensor high up has
/// no ground nearer, and cells start up to there.
void grow_ground(const CellPoints& points, const Patches& patches, double plane_within_m,
                 HeightGrid& grid);

}  // namespace stillmap::mapping
