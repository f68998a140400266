#pragma once

#include "detection/voxelnext/feature_rows.hpp"
#include "detection/voxelnext/sites.hpp"
#include "detection/voxelnext/weights.hpp"

#include <stillmap/mapping/ground.hpp>
#include <stillmap/maps/scan.hpp>

#include <optional>

namespace stillmap::mapping {

/// The network's z of things in a scan.
class NetworkHeight {
 public:
  /// @param surface  may be null: no ground is known anywhere.
  NetworkHeight(VoxelNextHeight z, double sensor_height_m, const GroundSurface* surface);
  NetworkHeight(const VoxelNextConfig& config, const GroundSurface* surface)
      : NetworkHeight(config.z, config.sensor_height_m, surface) {}
  /// z [m, lidar frame] of the network's zero at x, y [m, lidar frame]. None with kGround where no
  /// ground is known. With kLidar the same everywhere: the sensor's height above the network's zero
  /// is taken to be `sensor_height_m` over the ground under it, and where none is known there, the
  /// scan's own zero.
  [[nodiscard]] std::optional<double> zero_at(double x, double y) const;

 private:
  const GroundSurface* surface_ = nullptr;
  bool over_ground_ = false;
  double zero_ = 0.0;
};

struct Voxels {
  SiteSet sites;
  /// Means of each site's points, channels as in the config.
  FeatureRows features;
};

/// round(range / voxel) cells in x and y, one more in z (as OpenPCDet's backbone has it).
[[nodiscard]] Triple voxel_grid(const VoxelNextConfig& config);

/// Points in the config's range fall into voxels. Points without a height are left out. The order
/// of points changes nothing but the last bits of means.
[[nodiscard]] Voxels voxelize(const VoxelNextConfig& config, const maps::PointCloud& cloud,
                              const NetworkHeight& height);

}  // namespace stillmap::mapping
