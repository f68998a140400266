#pragma once

#include "core/byte_reader.hpp"

#include <stillmap/mapping/map_consistency.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

namespace stillmap::mapping {

/// A map point that was measured where it lies.
struct SurfacePoint {
  /// From the lower corner of the tile, z from the map's origin [m].
  Eigen::Vector3f position = Eigen::Vector3f::Zero();
  /// How many scanned points it is the mean of, >= 1.
  float weight = 1.0F;
  bool is_ground = false;
};

/// A cell of 0.5 m (or 5 voxels) of a tile, with the points of one kind in it.
struct SurfaceCell {
  /// Order in which the cells of a tile are listed: kind, then place. Equal in two maps whose tiles
  /// are of one frame.
  std::uint64_t key = 0;
  bool is_ground = false;
  /// Root mean square distance of the points from their plane [m]; NaN with too few points.
  double thickness_m = std::numeric_limits<double>::quiet_NaN();
  /// Whether the points spread along a plane rather than in all directions.
  bool is_planar = false;
  /// Of the points in the cell that have an entropy [nat].
  double entropy_sum = 0.0;
  std::uint32_t entropy_points = 0;

  [[nodiscard]] bool has_thickness() const { return thickness_m == thickness_m; }
};

/// The measured points of a tile. @param id  whose corner the positions are counted from.
[[nodiscard]] std::vector<SurfacePoint> surface_points(maps::TileId id, const maps::MapTile& tile);

/// The cells of a tile that hold a point, by key. Of voxels finer than 0.2 m one point in
/// (0.2 m / voxel)^2 has an entropy, so that the time does not grow with the square of their
/// number.
/// @param points        of the tile of 20 m alone. Points within `entropy_radius_m` of its border
/// have no entropy, because some of their neighbours may lie in the next tile.
/// @param voxel_size_m  edge of the voxels that merged the points.
/// @throws std::invalid_argument for a point that is not finite.
[[nodiscard]] std::vector<SurfaceCell> surface_cells(const std::vector<SurfacePoint>& points,
                                                     double voxel_size_m);

/// How far around a point its entropy looks [m].
[[nodiscard]] double entropy_radius_m(double voxel_size_m);

/// Adds up cells in memory that does not grow with their number.
class ConsistencySum {
 public:
  ConsistencySum();
  void add(const std::vector<SurfaceCell>& cells);
  /// Sums of doubles: in the same order the same bits.
  void add(const ConsistencySum& other);
  [[nodiscard]] MapConsistency result() const;

  /// For records of a build: all of it, bit by bit.
  void put_into(std::string& bytes) const;
  /// @throws std::invalid_argument.
  void get_from(ByteReader& reader);

 private:
  /// Of one kind of surface: cells, and a histogram of the planar ones' thickness.
  struct Kind {
    std::uint64_t cells = 0;
    std::vector<std::uint64_t> planar;
  };
  double entropy_sum_ = 0.0;
  std::uint64_t entropy_points_ = 0;
  /// Walls, ground.
  std::array<Kind, 2> kinds_;
};

}  // namespace stillmap::mapping
