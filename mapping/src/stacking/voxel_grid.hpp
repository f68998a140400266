#pragma once

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <optional>

namespace stillmap::mapping {

/// The origin of a map around a place: a corner of the tiles of the map frame, which are 20 m wide
/// and begin at its zero, and whole metres in height. So all maps of one frame have the same tiles,
/// and slightly different poses of one place give the same origin.
[[nodiscard]] Eigen::Vector3d map_origin_near(const Eigen::Vector3d& p_map);

/// The voxels of a map, counted from the lower corner of each 20 m tile, so that none crosses a
/// tile's border (the last one of a row is cut where the edge does not divide 20 m).
class VoxelGrid {
 public:
  struct Place {
    maps::TileId tile;
    /// Voxel within the tile: x, y, z in 10, 10 and 21 bits.
    std::uint64_t voxel = 0;
    /// From the voxel's lower corner [m].
    Eigen::Vector3f offset = Eigen::Vector3f::Zero();
  };

  /// @param origin        subtracted before points become floats [m].
  /// @param voxel_size_m  edge of a voxel, >= 0.02.
  VoxelGrid(const Eigen::Vector3d& origin, double voxel_size_m);

  /// @return nothing for a point that is not finite, or too far from the origin for the bits.
  [[nodiscard]] std::optional<Place> find(const Eigen::Vector3d& p_map) const;
  /// @param offset  from the voxel's lower corner [m]. @return from the origin [m].
  [[nodiscard]] Eigen::Vector3d position(maps::TileId tile, std::uint64_t voxel,
                                         const Eigen::Vector3d& offset) const;

  [[nodiscard]] const Eigen::Vector3d& origin() const { return origin_; }
  [[nodiscard]] double voxel_size_m() const { return voxel_size_m_; }

 private:
  Eigen::Vector3d origin_;
  double voxel_size_m_;
  double inverse_voxel_;
  /// Number of the last voxel of a tile's row.
  double last_side_;
};

}  // namespace stillmap::mapping
