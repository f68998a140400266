#pragma once

#include <Eigen/Core>

#include <Eigen/Geometry>
#include <stillmap/maps/cell_table.hpp>

#include <stillmap/mapping/ground.hpp>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// A voxel of what stands on the ground.
struct Obstacle {
  /// x and y in the local frame, then the height over the ground [m]: streets on slopes look like
  /// flat ones.
  Eigen::Vector3f position = Eigen::Vector3f::Zero();
  std::uint32_t scans = 0;
  /// Of what lies within 0.3 m, 255 = a plane; see `estimate_normals`.
  std::uint8_t planarity = 0;
};

/// The obstacles of one scan, a voxel each; sorted by key.
struct ScanObstacles {
  struct Voxel {
    std::uint64_t key = 0;
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    std::uint32_t points = 0;
  };
  std::vector<Voxel> voxels;
};

/// Everything within 35 m of the sensor that is not ground and 0.1 to 4 m high, in voxels of
/// 0.15 m.
/// @param positions  N points, lidar frame [m]. @param is_ground  N flags, 1 = ground.
/// @note Pure, so safe from several threads.
[[nodiscard]] ScanObstacles reduce_obstacles(const std::vector<Eigen::Vector3f>& positions,
                                             const std::vector<std::uint8_t>& is_ground,
                                             const GroundSurface& surface,
                                             const Eigen::Isometry3d& T_local_lidar);

/// Edge of the voxels [m].
inline constexpr float kObstacleVoxelM = 0.15F;

/// What stands on the ground around some place.
class ObstacleMap {
 public:
  explicit ObstacleMap(const std::vector<Obstacle>& obstacles);

  /// Obstacles whose x and y lie in a circle [m].
  [[nodiscard]] std::vector<const Obstacle*> around(const Eigen::Vector2d& centre,
                                                    double radius_m) const;

 private:
  /// By square of 2 m.
  maps::CellMap<std::vector<Obstacle>> squares_;
};

}  // namespace stillmap::mapping
