#include "levels/voxel_thinning.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace stillmap::maps {
namespace {

struct Candidate {
  std::uint64_t voxel;
  float distance2;
  std::uint32_t index;
};

/// Bits of a voxel's number that each axis has. Beyond them, which is wider than any tile of a map
/// that was built here, voxels at the rim grow together.
constexpr std::array<unsigned, 3> kBits = {20, 20, 24};

/// Numbers the voxels of one tile.
class Voxels {
 public:
  Voxels(double bottom_m, double edge_m) : bottom_m_(bottom_m), edge_m_(edge_m) {}

  [[nodiscard]] Candidate candidate(const MapPoint& p, std::uint32_t index) const {
    const std::array<double, 3> xyz{p.x, p.y, p.z - bottom_m_};
    Candidate candidate{.voxel = 0, .distance2 = 0.0F, .index = index};
    double distance2 = 0.0;
    for (std::size_t axis = 0; axis < xyz.size(); ++axis) {
      const double cells = xyz[axis] / edge_m_;
      const double most = static_cast<double>((std::uint64_t{1} << kBits[axis]) - 1);
      const double cell = std::clamp(std::floor(cells), 0.0, most);
      candidate.voxel = (candidate.voxel << kBits[axis]) | static_cast<std::uint64_t>(cell);
      const double off = cells - cell - 0.5;
      distance2 += off * off;
    }
    candidate.distance2 = static_cast<float>(distance2);
    return candidate;
  }

 private:
  double bottom_m_;
  double edge_m_;
};

bool is_finite(const MapPoint& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

double lowest(const std::vector<MapPoint>& points) {
  double low = std::numeric_limits<double>::infinity();
  for (const MapPoint& p : points)
    if (is_finite(p)) low = std::min(low, static_cast<double>(p.z));
  return low;
}

}  // namespace

std::vector<MapPoint> thinned_by_voxel(const std::vector<MapPoint>& points, double edge_m) {
  const Voxels voxels(std::floor(lowest(points) / edge_m) * edge_m, edge_m);
  std::vector<Candidate> candidates;
  candidates.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (is_finite(points[i]))
      candidates.push_back(voxels.candidate(points[i], static_cast<std::uint32_t>(i)));
  }
  std::sort(candidates.begin(), candidates.end(), [&](const Candidate& a, const Candidate& b) {
    if (a.voxel != b.voxel) return a.voxel < b.voxel;
    if (a.distance2 != b.distance2) return a.distance2 < b.distance2;
    const std::uint16_t of_a = points[a.index].observations;
    const std::uint16_t of_b = points[b.index].observations;
    return of_a != of_b ? of_a > of_b : a.index < b.index;
  });
  const auto others =
      std::unique(candidates.begin(), candidates.end(),
                  [](const Candidate& a, const Candidate& b) { return a.voxel == b.voxel; });
  candidates.erase(others, candidates.end());
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.index < b.index; });
  std::vector<MapPoint> kept;
  kept.reserve(candidates.size());
  for (const Candidate& each : candidates) kept.push_back(points[each.index]);
  return kept;
}

}  // namespace stillmap::maps
