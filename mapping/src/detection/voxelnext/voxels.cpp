#include "detection/voxelnext/voxels.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace stillmap::mapping {

namespace {

/// Points whose heights are looked up in one go.
constexpr std::size_t kGrain = 1024;
/// Cell of a point outside the range.
constexpr Triple kOutside{-1, -1, -1};

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

/// Cell of one coordinate, -1 outside; NaN is outside.
int cell_of(const VoxelNextConfig& config, std::size_t axis, int cells, double value) {
  const double low = config.range_m[axis];
  if (!(value >= low && value < config.range_m[axis + 3])) return -1;
  return std::min(static_cast<int>((value - low) / config.voxel_m[axis]), cells - 1);
}

float feature_of(VoxelFeature feature, const VoxelNextConfig& config, const Triple& cell,
                 const Sums& mean) {
  const auto within = [&](std::size_t axis, int index, double value) {
    return static_cast<float>((value - config.range_m[axis]) / config.voxel_m[axis] - index - 0.5);
  };
  const auto direction = [&](double value) {
    const double r = std::sqrt(mean.x * mean.x + mean.y * mean.y);
    return r > 0.0 ? static_cast<float>(value / r) : 0.0F;
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
      return direction(mean.x);
    case VoxelFeature::kUy:
      return direction(mean.y);
  }
  return 0.0F;
}

/// Adds points up in their order.
std::vector<Sums> sum_points(const maps::PointCloud& cloud, const SiteSet& sites,
                             const std::vector<Triple>& cells, const std::vector<double>& z) {
  std::vector<Sums> out(sites.size());
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    if (cells[k] == kOutside) continue;
    Sums& sums = out[sites.find(cells[k])];
    sums.x += static_cast<double>(cloud.positions[k].x());
    sums.y += static_cast<double>(cloud.positions[k].y());
    sums.z += z[k];
    if (!cloud.intensities.empty()) sums.intensity += static_cast<double>(cloud.intensities[k]);
    sums.points += 1.0;
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
  const auto ground = surface_->at(x, y);
  return ground ? std::optional(ground->z) : std::nullopt;
}

Triple voxel_grid(const VoxelNextConfig& config) {
  return {cells_of(config, 2) + 1, cells_of(config, 1), cells_of(config, 0)};
}

Voxels voxelize(const VoxelNextConfig& config, const maps::PointCloud& cloud,
                const NetworkHeight& height) {
  Voxels out{SiteSet(voxel_grid(config)), {}};
  const Triple& grid = out.sites.grid();
  std::vector<double> z(cloud.size());
  std::vector<Triple> cells(cloud.size(), kOutside);
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, cloud.size(), kGrain), [&](const auto& range) {
        for (std::size_t k = range.begin(); k < range.end(); ++k) {
          const Eigen::Vector3d p = cloud.positions[k].cast<double>();
          const int x = cell_of(config, 0, grid.x, p.x()), y = cell_of(config, 1, grid.y, p.y());
          if (x < 0 || y < 0) continue;
          const std::optional<double> zero = height.zero_at(p.x(), p.y());
          if (!zero) continue;
          z[k] = p.z() - *zero;
          const int layer = cell_of(config, 2, grid.z - 1, z[k]);
          if (layer >= 0) cells[k] = {layer, y, x};
        }
      });
  for (const Triple& cell : cells) {
    if (cell != kOutside) out.sites.mark(cell);
  }
  out.sites.number_sites();
  std::vector<Sums> sums = sum_points(cloud, out.sites, cells, z);
  out.features = FeatureRows(out.sites.size(), config.features.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, sums.size(), kGrain),
                    [&](const auto& range) {
                      for (std::size_t site = range.begin(); site < range.end(); ++site) {
                        Sums& mean = sums[site];
                        for (double* value : {&mean.x, &mean.y, &mean.z, &mean.intensity})
                          *value /= mean.points;
                        float* row = out.features.row(site);
                        for (std::size_t f = 0; f < config.features.size(); ++f)
                          row[f] = feature_of(config.features[f], config, out.sites[site], mean);
                      }
                    });
  return out;
}

}  // namespace stillmap::mapping
