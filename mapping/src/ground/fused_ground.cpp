#include "ground/fused_ground.hpp"

#include "ground/ground_smoothing.hpp"
#include "ground/ground_spread.hpp"
#include "ground/ground_under.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// Corners of a query that agree within this belong to one surface [m]; beyond, a step lies
/// between, and the nearest cell alone answers, so that steps stay steps.
constexpr double kFusedStepM = 0.04;
/// Cells to the nearest measured one at which confidence would be 0: 12 m.
constexpr double kFarCells = 48.0;

struct Corner {
  double weight = 0.0;
  double z = 0.0;
  double slope_x = 0.0;
  double slope_y = 0.0;
  double confidence = 0.0;
};

[[nodiscard]] Corner corner_of(const GroundNode& node, double dx, double dy) {
  const double wx = 1.0 - std::abs(dx) / kGroundCellM;
  const double wy = 1.0 - std::abs(dy) / kGroundCellM;
  const auto slope_x = static_cast<double>(node.slope_x);
  const auto slope_y = static_cast<double>(node.slope_y);
  const double near = 1.0 - static_cast<double>(node.reach) / kFarCells;
  // Never quite zero: a lone cell carries all of itself.
  return {wx * wy + 1e-9, static_cast<double>(node.z) + slope_x * dx + slope_y * dy, slope_x,
          slope_y, near * static_cast<double>(node.confidence_255) / 255.0};
}

[[nodiscard]] GroundSurface::Sample sample_of(const Corner& corner) {
  return {corner.z, Eigen::Vector3d(-corner.slope_x, -corner.slope_y, 1.0).normalized(),
          corner.confidence};
}

}  // namespace

void FusedGround::add(const GroundCells& ground) {
  if (finished_) throw std::logic_error("fused ground: added to after the end");
  piles_.add(ground);
}

void FusedGround::finish(std::span<const GroundFootprint> footprints) {
  if (finished_) throw std::logic_error("fused ground: finished twice");
  finished_ = true;
  MeasuredSheets ground = sheets_of(std::move(piles_).take_sheets(), scratch_);
  drop_islands(ground);
  suspect_ground_under(ground, footprints);
  smooth_measured(ground);
  spread_ground(ground);
  if (accept_suspects(ground) > 0) {
    smooth_measured(ground);
    spread_ground(ground);
  }
  lay_ground_under(ground, footprints);
  sheets_ = std::move(ground.sheets);
}

std::optional<GroundSurface::Sample> FusedGround::at(double x, double y,
                                                     std::optional<double> z) const {
  if (!(std::abs(x) < kMaxGroundCell * kGroundCellM && std::abs(y) < kMaxGroundCell * kGroundCellM))
    return std::nullopt;
  const int cell_x = ground_cell_of(x);
  const int cell_y = ground_cell_of(y);
  const auto home = sheets_.find(cell_x, cell_y, z);
  if (!home) return std::nullopt;
  const double dx = x - ground_cell_centre(cell_x);
  const double dy = y - ground_cell_centre(cell_y);
  const Corner nearest = corner_of(sheets_.node(*home), dx, dy);
  Corner sum;
  for (int k = 0; k < 4; ++k) {
    const int ix = (k & 1) != 0 ? (dx < 0.0 ? -1 : 1) : 0;
    const int iy = (k & 2) != 0 ? (dy < 0.0 ? -1 : 1) : 0;
    const auto place = sheets_.beside(home->sheet, home->node % GroundSheets::kSide + ix,
                                      home->node / GroundSheets::kSide + iy);
    if (place.sheet == GroundSheets::kNone) continue;
    const GroundNode& node = sheets_.node(place);
    if (node.state == GroundState::kUnknown) continue;
    const Corner c = corner_of(node, dx - ix * kGroundCellM, dy - iy * kGroundCellM);
    if (std::abs(c.z - nearest.z) > kFusedStepM) continue;
    sum.weight += c.weight;
    sum.z += c.weight * c.z;
    sum.slope_x += c.weight * c.slope_x;
    sum.slope_y += c.weight * c.slope_y;
    sum.confidence += c.weight * c.confidence;
  }
  return sample_of({1.0, sum.z / sum.weight, sum.slope_x / sum.weight, sum.slope_y / sum.weight,
                    sum.confidence / sum.weight});
}

std::optional<GroundBelow::Foot> BelowFused::below(const Eigen::Vector3f& p) const {
  // A measured cell is right within a few centimetres, one that was filled in less so.
  constexpr double kMeasuredM = 0.06;
  constexpr double kFilledM = 0.1;
  constexpr double kLevelM = 2.0;
  const Eigen::Vector3d p_local = T_local_lidar_ * p.cast<double>();
  const auto sample = ground_.at(p_local.x(), p_local.y(), p_local.z());
  // Of a level far above nothing stands on the ground: that below was never seen.
  if (!sample || sample->z > p_local.z() + kLevelM) return std::nullopt;
  const Eigen::Vector3d foot(p_local.x(), p_local.y(), sample->z);
  return Foot{(T_lidar_local_ * foot).cast<float>(), p_local.z() - sample->z,
              sample->confidence > 0.5 ? kMeasuredM : kFilledM, sample->confidence};
}

}  // namespace stillmap::mapping
