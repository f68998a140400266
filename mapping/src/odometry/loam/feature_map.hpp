#pragma once

#include <Eigen/Core>

#include <stillmap/maps/cell_table.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping::loam {

/// Neighbours that a line or plane of the map is fitted to (section VI: the authors' code takes 5).
inline constexpr std::size_t kMapNeighbours = 5;

/// Features of one kind around the sensor, thinned to a mean a voxel.
///
/// The paper keeps points in cubes and builds a kd-tree of those around the sensor for each scan,
/// most of its time. Here cubes are cells of a hash table, each with the means of its voxels, and
/// the nearest points come from the eight cells around a query: nothing is built, and what is near
/// lies together in memory. Means are kept relative to their cell, exact however far the drive
/// goes.
class FeatureMap {
 public:
  /// @param cell_m  edge of a cell; neighbours are found up to half of it away.
  FeatureMap(double cell_m, double voxel_m);

  void add(const Eigen::Vector3d& p_odom);

  struct Neighbours {
    /// Relative to the query, nearest first.
    std::array<Eigen::Vector3f, kMapNeighbours> points;
    std::size_t count = 0;
    [[nodiscard]] std::span<const Eigen::Vector3f> span() const {
      return std::span(points).first(count);
    }
  };
  /// The five nearest within half a cell; fewer where there are fewer.
  [[nodiscard]] Neighbours nearest(const Eigen::Vector3d& q_odom) const;

  /// Forgets cells farther than this from a place.
  void keep_around(const Eigen::Vector3d& centre_odom, double radius_m);
  void clear();
  [[nodiscard]] std::size_t size() const { return points_; }

 private:
  struct Point {
    Eigen::Vector3f mean;
    std::uint16_t voxel;
    std::uint16_t count;
  };
  using Key = std::array<std::int32_t, 3>;
  struct Cell {
    Key key;
    std::vector<Point> points;
  };

  [[nodiscard]] Key key_of(const Eigen::Vector3d& p) const;
  [[nodiscard]] const Cell* find(const Key& key) const;
  Cell& find_or_add(const Key& key);
  [[nodiscard]] static std::uint64_t number_key(const Key& key);
  [[nodiscard]] auto key_at() const {
    return [this](std::uint32_t number) { return number_key(cells_[number].key); };
  }

  double cell_m_;
  double voxel_m_;
  std::size_t points_ = 0;
  std::vector<Cell> cells_;
  maps::CellIndex index_;
};

}  // namespace stillmap::mapping::loam
