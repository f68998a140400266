#include "ground/region_fit.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

// The authors' settings.
constexpr std::size_t kMinPoints = 10;
constexpr int kIterations = 3;
constexpr std::size_t kLowest = 20;
constexpr float kSeedM = 0.125F;
constexpr float kRegionPlaneM = 0.125F;
constexpr float kVerticalSeedM = 0.25F;
constexpr float kVerticalPlaneM = 0.1F;
/// cos 45 degrees.
constexpr double kRegionUpright = 0.707;

/// Mean height of the lowest points. Moves points about.
[[nodiscard]] std::optional<float> low_height(std::vector<CellPoint>& points, float deepest_m) {
  const auto end_deep = std::partition(points.begin(), points.end(),
                                       [&](const CellPoint& p) { return p.z < -deepest_m; });
  const auto left = static_cast<std::size_t>(points.end() - end_deep);
  if (left == 0) return std::nullopt;
  const auto count = static_cast<std::ptrdiff_t>(std::min(kLowest, left));
  std::nth_element(end_deep, end_deep + (count - 1), points.end(),
                   [](const CellPoint& a, const CellPoint& b) { return a.z < b.z; });
  float sum = 0.0F;
  for (auto p = end_deep; p != end_deep + count; ++p) sum += p->z;
  return sum / static_cast<float>(count);
}

/// Plane through the points below a height, and those not far below it.
[[nodiscard]] std::optional<PlaneFit> seed_plane(const std::vector<CellPoint>& points, float low_m,
                                                 float thickness_m) {
  PlaneSums sums;
  for (const CellPoint& p : points) {
    if (p.z < low_m + thickness_m && p.z > low_m - thickness_m)
      sums.add(static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z));
  }
  if (sums.points() < 3) return std::nullopt;
  return sums.fit();
}

/// Signed distance to a plane in single precision.
class Distance {
 public:
  explicit Distance(const PlaneFit& plane)
      : normal_(plane.normal.cast<float>()),
        offset_(static_cast<float>(plane.normal.dot(plane.mean))) {}
  float operator()(const CellPoint& p) const {
    return normal_.x() * p.x + normal_.y() * p.y + normal_.z() * p.z - offset_;
  }

 private:
  Eigen::Vector3f normal_;
  float offset_;
};

/// R-VPF.
int set_verticals_aside(std::vector<CellPoint>& points, float deepest_m) {
  const std::size_t before = points.size();
  for (int k = 0; k < kIterations; ++k) {
    const auto low_m = low_height(points, deepest_m);
    if (!low_m) break;
    const auto plane = seed_plane(points, *low_m, kVerticalSeedM);
    if (!plane || plane->uprightness() >= kRegionUpright) break;
    const Distance distance(*plane);
    std::erase_if(points,
                  [&](const CellPoint& p) { return std::abs(distance(p)) < kVerticalPlaneM; });
  }
  return static_cast<int>(before - points.size());
}

}  // namespace

std::optional<RegionFit> fit_region(std::span<const CellPoint> points, double deepest_seed_m,
                                    std::vector<CellPoint>& scratch) {
  if (points.size() < kMinPoints) return std::nullopt;
  const auto deepest_m = static_cast<float>(deepest_seed_m);
  scratch.assign(points.begin(), points.end());
  RegionFit region;
  region.vertical_points = set_verticals_aside(scratch, deepest_m);
  const auto low_m = low_height(scratch, deepest_m);
  if (!low_m) return std::nullopt;
  auto plane = seed_plane(scratch, *low_m, kSeedM);
  for (int k = 0; k < kIterations && plane; ++k) {
    const Distance distance(*plane);
    PlaneSums sums;
    for (const CellPoint& p : scratch) {
      if (std::abs(distance(p)) < kRegionPlaneM)
        sums.add(static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z));
    }
    if (sums.points() < 3) return std::nullopt;
    plane = sums.fit();
  }
  if (!plane) return std::nullopt;
  region.plane = *plane;
  return region;
}

}  // namespace stillmap::mapping
