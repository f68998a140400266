#include "ground/plane_under_sensor.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Points of a cell that are looked at, spread over it.
constexpr std::size_t kSampled = 40;
constexpr std::size_t kLowestUnderSensor = 8;
/// Three points within this height [m] are a layer; reflections are scattered in depth.
constexpr float kSensorLayerM = 0.1F;
/// Fewer cells than this are no ground to stand on while there are farther ones.
constexpr std::size_t kFewCells = 40;
/// Cells lie on a plane up to this far from it [m], as in its search.
constexpr double kOnPlaneM = 0.12;
/// Ground that lies lower than a plane of few cells by this is another one [m]. From high up the
/// lowest beam draws such planes on house fronts.
constexpr double kLowerM = 0.5;

[[nodiscard]] Eigen::Vector3d low_point(std::span<const CellPoint> points,
                                        std::vector<CellPoint>& scratch) {
  scratch.clear();
  const std::size_t stride = (points.size() + kSampled - 1) / kSampled;
  for (std::size_t i = 0; i < points.size(); i += stride) scratch.push_back(points[i]);
  const std::size_t lowest = std::min(kLowestUnderSensor, scratch.size());
  std::partial_sort(scratch.begin(), scratch.begin() + static_cast<std::ptrdiff_t>(lowest),
                    scratch.end(),
                    [](const CellPoint& a, const CellPoint& b) { return a.z < b.z; });
  std::size_t at = scratch.size() >= 4 ? 1 : 0;
  for (std::size_t i = 0; i + 2 < lowest; ++i) {
    if (scratch[i + 2].z - scratch[i].z > kSensorLayerM) continue;
    at = i + 1;
    break;
  }
  return Eigen::Vector3f(scratch[at].x, scratch[at].y, scratch[at].z).cast<double>();
}

[[nodiscard]] bool holds_few(const SeedPlane& plane, const std::vector<Eigen::Vector3d>& lows) {
  const auto on_it = std::count_if(lows.begin(), lows.end(), [&](const Eigen::Vector3d& p) {
    return std::abs(p.z() - plane.z_at(p.x(), p.y())) <= kOnPlaneM;
  });
  return static_cast<std::size_t>(on_it) < kFewCells;
}

}  // namespace

std::optional<SeedPlane> find_plane_under_sensor(const CellPoints& points,
                                                 const std::optional<HeightPrior>& prior) {
  const PatchLayout& layout = PatchLayout::instance();
  std::vector<CellPoint> scratch;
  // Near cells first: farther out the street may bend away from any one plane.
  constexpr float kFarthestM = 60.0F;
  std::optional<SeedPlane> found;
  for (const float max_range_m : {12.0F, 25.0F, kFarthestM}) {
    std::vector<Eigen::Vector3d> lows;
    for (const int cell : points.near_to_far()) {
      if (layout.range_m[static_cast<std::size_t>(cell)] > max_range_m) break;
      lows.push_back(low_point(points.of_cell(cell), scratch));
    }
    if (lows.size() < kFewCells && max_range_m < kFarthestM) continue;
    auto plane = find_seed_plane(lows, prior);
    if (!plane || (found && plane->height > found->height - kLowerM)) continue;
    plane->found_within_m = static_cast<double>(max_range_m);
    if (!holds_few(*plane, lows)) return plane;
    if (!found) found = plane;
  }
  return found;
}

}  // namespace stillmap::mapping
