#include "ground/plane_under_sensor.hpp"

#include <algorithm>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Points of a cell that are looked at, spread over it.
constexpr std::size_t kSampled = 40;
constexpr std::size_t kLowest = 8;
/// Three points within this height [m] are a layer; reflections are scattered in depth.
constexpr float kLayerM = 0.1F;
/// Fewer cells than this are no ground to stand on while there are farther ones.
constexpr std::size_t kFewCells = 40;

[[nodiscard]] Eigen::Vector3d low_point(std::span<const CellPoint> points,
                                        std::vector<CellPoint>& scratch) {
  scratch.clear();
  const std::size_t stride = (points.size() + kSampled - 1) / kSampled;
  for (std::size_t i = 0; i < points.size(); i += stride) scratch.push_back(points[i]);
  const std::size_t lowest = std::min(kLowest, scratch.size());
  std::partial_sort(scratch.begin(), scratch.begin() + static_cast<std::ptrdiff_t>(lowest),
                    scratch.end(),
                    [](const CellPoint& a, const CellPoint& b) { return a.z < b.z; });
  std::size_t at = scratch.size() >= 4 ? 1 : 0;
  for (std::size_t i = 0; i + 2 < lowest; ++i) {
    if (scratch[i + 2].z - scratch[i].z > kLayerM) continue;
    at = i + 1;
    break;
  }
  return Eigen::Vector3f(scratch[at].x, scratch[at].y, scratch[at].z).cast<double>();
}

}  // namespace

std::optional<SeedPlane> find_plane_under_sensor(const CellPoints& points,
                                                 const std::optional<HeightPrior>& prior) {
  const PatchLayout& layout = PatchLayout::instance();
  std::vector<CellPoint> scratch;
  // Near cells first: farther out the street may bend away from any one plane.
  constexpr float kFarthestM = 60.0F;
  for (const float max_range_m : {12.0F, 25.0F, kFarthestM}) {
    std::vector<Eigen::Vector3d> lows;
    for (const int cell : points.near_to_far()) {
      if (layout.range_m[static_cast<std::size_t>(cell)] > max_range_m) break;
      lows.push_back(low_point(points.of_cell(cell), scratch));
    }
    if (lows.size() < kFewCells && max_range_m < kFarthestM) continue;
    if (const auto plane = find_seed_plane(lows, prior)) return plane;
  }
  return std::nullopt;
}

}  // namespace stillmap::mapping
