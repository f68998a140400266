#include <stillmap/localization/thinning.hpp>

#include "voxel_table.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::localization {
namespace {

constexpr float kMaxRangeM = 500.0F;
/// What is nearer is the vehicle itself, which no map holds: bonnet and tail of a car reach 2.5 m
/// from a sensor on its roof. Where much is that near, one is in a narrow place, and it counts.
constexpr float kOwnVehicleM = 2.7F;
constexpr float kMostOwnShare = 0.25F;
/// Larger scans are strided down to this first; neighbours in the scan are closer than a cell
/// anyway.
constexpr std::size_t kMaxRead = 400'000;

/// Range below which points are left out.
float nearest_range_m(std::span<const Eigen::Vector3f> positions) {
  const auto near = std::count_if(positions.begin(), positions.end(), [](const auto& p) {
    return p.squaredNorm() < kOwnVehicleM * kOwnVehicleM;
  });
  const float share = static_cast<float>(near) / static_cast<float>(positions.size() + 1);
  return share < kMostOwnShare ? kOwnVehicleM : 0.0F;
}

}  // namespace

std::vector<std::size_t> one_point_a_cell(std::span<const Eigen::Vector3f> positions,
                                          float cell_m) {
  const float nearest_m = nearest_range_m(positions);
  std::vector<std::size_t> kept;
  VoxelTable cells(positions.size() / 8);
  const auto cell_of = [&](float coordinate_m) {
    return static_cast<std::int32_t>(std::floor(coordinate_m / cell_m)) + kCellsPerAxis / 2;
  };
  const std::size_t step = positions.size() / kMaxRead + 1;
  for (std::size_t i = 0; i < positions.size(); i += step) {
    const Eigen::Vector3f& p = positions[i];
    const float range2 = p.squaredNorm();
    if (!(range2 < kMaxRangeM * kMaxRangeM) || range2 < nearest_m * nearest_m) continue;
    if (cells.insert(cell_key(cell_of(p.x()), cell_of(p.y()), cell_of(p.z()))).second)
      kept.push_back(i);
  }
  return kept;
}

}  // namespace stillmap::localization
