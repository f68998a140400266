#pragma once

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace stillmap::localization {

/// Most points that `thinned` leaves: some three times as many as a scan of 64 rings, so that only
/// what is no scan of the world (noise that fills space) meets it and a query's time is bounded.
inline constexpr std::size_t kMaxThinnedPoints = 40'000;

/// One centroid for each cell of `leaf_m` [m] that holds a point, in the order in which the cells
/// are met; cells begin at the frame's origin, as in PCL's VoxelGrid. Points beyond 500 m are left
/// out: no lidar of ours sees them, and they would overflow the grid. Of more than 400,000 points
/// every k-th is read, and of more than `kMaxThinnedPoints` centroids every k-th is kept.
[[nodiscard]] std::vector<Eigen::Vector3f> thinned(std::span<const Eigen::Vector3f> points_lidar,
                                                   double leaf_m);

/// The measured points of a map, thinned to one centroid a cell and found by a kd-tree: what the
/// reference methods align with. Coordinates are relative to `origin()`, the mean of all points, so
/// that floats keep their millimetres. Immutable, safe from several threads.
class MapPoints {
 public:
  struct Point {
    /// Relative to `origin()` [m].
    Eigen::Vector3f position = Eigen::Vector3f::Zero();
    /// Unit directions across the surface; those from `sharp_axes` on have no meaning.
    std::array<Eigen::Vector3f, 2> axes{};
    /// 1 on a plane (its normal), 2 on an upright line (a pole), 0 where the neighbours have no
    /// such shape (foliage, a lone ring of the sensor).
    int sharp_axes = 0;
  };

  /// @param leaf_m  edge of the cells [m], > 0.
  /// @throws std::invalid_argument on a broken edge, maps::InputError if there is no measured
  /// point, one is not finite, or the map is larger than the grid.
  [[nodiscard]] static std::shared_ptr<const MapPoints> build(const maps::MapPackage& map,
                                                              double leaf_m);
  /// Same from points [m] in the map frame. @throws std::invalid_argument if one is not finite.
  [[nodiscard]] static std::shared_ptr<const MapPoints> build(
      const std::vector<Eigen::Vector3d>& points_map, double leaf_m);
  ~MapPoints();
  MapPoints(const MapPoints&) = delete;
  MapPoints& operator=(const MapPoints&) = delete;

  [[nodiscard]] const Eigen::Vector3d& origin() const { return origin_; }
  [[nodiscard]] const std::vector<Point>& points() const { return points_; }
  /// Nearest point within `max_distance_m`, null when there is none. @param p  relative to
  /// `origin()` [m], finite.
  [[nodiscard]] const Point* nearest(const Eigen::Vector3f& p, float max_distance_m) const;
  /// Whether a place, relative to `origin()` [m], lies within the map's bounds or `margin_m` around
  /// them.
  [[nodiscard]] bool within_bounds(const Eigen::Vector3d& p, double margin_m) const;

 private:
  class Tree;
  MapPoints();
  template <typename ForEachPoint>
  [[nodiscard]] static std::shared_ptr<const MapPoints> build_from(
      const ForEachPoint& for_each_point, const std::string& source, double leaf_m);
  void find_surfaces();

  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d min_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d max_ = Eigen::Vector3d::Zero();
  std::vector<Point> points_;
  std::unique_ptr<const Tree> tree_;
};

}  // namespace stillmap::localization
