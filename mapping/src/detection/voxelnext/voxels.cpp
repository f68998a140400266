#include "detection/voxelnext/voxels.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace stillmap::mapping {

namespace {

/// Points whose heights are looked up in one go.
constexpr std::size_t kGrain = 4096;

struct Sums {
  double x = 0.0, y = 0.0, z = 0.0, intensity = 0.0;
  double points = 0.0;
};

int cells_of(const VoxelNextConfig& config, std::size_t axis) {
  const double cells =
      std::round((config.range_m[axis + 3] - config.range_m[axis]) / config.voxel_m[axis]);
  // A grid this long is refused as a whole.
  return static_cast<int>(std::clamp(cells, 0.0, 1e9));
}

/// NaN is not.
bool is_within(const VoxelNextConfig& config, std::size_t axis, double value) {
  return value >= config.range_m[axis] && value < config.range_m[axis + 3];
}

/// Cell of a coordinate within the range.
int cell_of(const VoxelNextConfig& config, std::size_t axis, int cells, double value) {
  return std::min(static_cast<int>((value - config.range_m[axis]) / config.voxel_m[axis]),
                  cells - 1);
}

/// @param per_range  1 over the horizontal range; 0 at the sensor.
float feature_of(VoxelFeature feature, const VoxelNextConfig& config, const Triple& cell,
                 const Sums& mean, double per_range) {
  const auto within = [&](std::size_t axis, int index, double value) {
    return static_cast<float>((value - config.range_m[axis]) / config.voxel_m[axis] - index - 0.5);
  };
  switch (feature) {
    case VoxelFeature::kX:
      return static_cast<float>(mean.x);
    case VoxelFeature::kY:
      return static_cast<float>(mean.y);
    case VoxelFeature::kZ:
    case VoxelFeature::kHeight:
      return static_cast<float>(mean.z);
    case VoxelFeature::kIntensity:
      return static_cast<float>(mean.intensity);
    case VoxelFeature::kZero:
      return 0.0F;
    case VoxelFeature::kDx:
      return within(0, cell.x, mean.x);
    case VoxelFeature::kDy:
      return within(1, cell.y, mean.y);
    case VoxelFeature::kDz:
      return within(2, cell.z, mean.z);
    case VoxelFeature::kUx:
      return static_cast<float>(mean.x * per_range);
    case VoxelFeature::kUy:
      return static_cast<float>(mean.y * per_range);
  }
  return 0.0F;
}

/// A point that falls into the grid.
struct PlacedPoint {
  std::uint32_t point = 0;
  Triple cell;
  /// Over the network's zero.
  double z = 0.0;
};

/// Those of points [begin, end), in their order.
std::vector<PlacedPoint> place(const VoxelNextConfig& config, const maps::PointCloud& cloud,
                               const NetworkHeight& height, const Triple& grid, std::size_t begin,
                               std::size_t end) {
  std::vector<PlacedPoint> placed;
  placed.reserve(end - begin);
  for (std::size_t k = begin; k < end; ++k) {
    const Eigen::Vector3d p = cloud.positions[k].cast<double>();
    if (!is_within(config, 0, p.x()) || !is_within(config, 1, p.y())) continue;
    const std::optional<double> zero = height.zero_at(p.x(), p.y());
    if (!zero) continue;
    const double z = p.z() - *zero;
    // Most are on the ground, below the range.
    if (!is_within(config, 2, z)) continue;
    placed.push_back({static_cast<std::uint32_t>(k),
                      {cell_of(config, 2, grid.z - 1, z), cell_of(config, 1, grid.y, p.y()),
                       cell_of(config, 0, grid.x, p.x())},
                      z});
  }
  return placed;
}

/// Adds points up in their order.
std::vector<Sums> sum_points(const maps::PointCloud& cloud, const SiteSet& sites,
                             const std::vector<std::vector<PlacedPoint>>& parts) {
  std::vector<Sums> out(sites.size());
  for (const std::vector<PlacedPoint>& part : parts) {
    for (const PlacedPoint& placed : part) {
      Sums& sums = out[sites.find(placed.cell)];
      const Eigen::Vector3f& p = cloud.positions[placed.point];
      sums.x += static_cast<double>(p.x());
      sums.y += static_cast<double>(p.y());
      sums.z += placed.z;
      if (!cloud.intensities.empty())
        sums.intensity += static_cast<double>(cloud.intensities[placed.point]);
      sums.points += 1.0;
    }
  }
  return out;
}

}  // namespace

NetworkHeight::NetworkHeight(VoxelNextHeight z, double sensor_height_m,
                             const GroundSurface* surface)
    : surface_(surface), over_ground_(z == VoxelNextHeight::kGround) {
  if (over_ground_ || surface_ == nullptr) return;
  if (const auto ground = surface_->at(0.0, 0.0)) zero_ = ground->z + sensor_height_m;
}

std::optional<double> NetworkHeight::zero_at(double x, double y) const {
  if (!over_ground_) return zero_;
  if (surface_ == nullptr) return std::nullopt;
  return surface_->z_at(x, y);
}

Triple voxel_grid(const VoxelNextConfig& config) {
  return {cells_of(config, 2) + 1, cells_of(config, 1), cells_of(config, 0)};
}

Voxels voxelize(const VoxelNextConfig& config, const maps::PointCloud& cloud,
                const NetworkHeight& height) {
  Voxels out{SiteSet(voxel_grid(config)), {}};
  const Triple& grid = out.sites.grid();
  std::vector<std::vector<PlacedPoint>> parts((cloud.size() + kGrain - 1) / kGrain);
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t i) {
    parts[i] =
        place(config, cloud, height, grid, i * kGrain, std::min(cloud.size(), (i + 1) * kGrain));
  });
  for (const std::vector<PlacedPoint>& part : parts) {
    for (const PlacedPoint& placed : part) out.sites.mark(placed.cell);
  }
  out.sites.number_sites();
  std::vector<Sums> sums = sum_points(cloud, out.sites, parts);
  out.features = FeatureRows(out.sites.size(), config.features.size());
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, sums.size(), kGrain), [&](const auto& range) {
        for (std::size_t site = range.begin(); site < range.end(); ++site) {
          Sums& mean = sums[site];
          for (double* value : {&mean.x, &mean.y, &mean.z, &mean.intensity}) *value /= mean.points;
          const double range_m = std::sqrt(mean.x * mean.x + mean.y * mean.y);
          const double per_range = range_m > 0.0 ? 1.0 / range_m : 0.0;
          float* row = out.features.row(site);
          for (std::size_t f = 0; f < config.features.size(); ++f)
            row[f] = feature_of(config.features[f], config, out.sites[site], mean, per_range);
        }
      });
  return out;
}

}  // namespace stillmap::mapping
