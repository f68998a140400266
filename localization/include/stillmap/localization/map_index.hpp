#pragma once

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace stillmap::localization {

/// How a map is turned into voxels.
struct MapIndexOptions {
  /// Edge of the finest voxel [m], in [0.1, 4]. Finer is sharper near the end and slower to build.
  double finest_voxel_m = 0.5;
  /// Number of levels, each twice as coarse, in [1, 6]. More widen the basin.
  int levels = 3;
  /// Voxels with fewer points than this carry no shape and are left out, >= 3.
  int min_points = 5;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// Voxels with mean, covariance and normal at several resolutions; what every aligner of ours
/// searches. Immutable, safe from several threads. Only `measured` points enter; coordinates are
/// relative to `origin()` so that floats keep their millimetres.
class MapIndex {
 public:
  /// @throws std::invalid_argument on broken options, maps::InputError if no voxel has enough
  /// points.
  [[nodiscard]] static std::shared_ptr<const MapIndex> build(const maps::MapPackage& map,
                                                             const MapIndexOptions& options = {});
  /// Same from points [m] in the map frame.
  [[nodiscard]] static std::shared_ptr<const MapIndex> build(
      const std::vector<Eigen::Vector3d>& points_map, const MapIndexOptions& options = {});
  struct Level;
  ~MapIndex();
  /// Corner of the map's bounds with the smallest coordinates, in the map frame [m].
  [[nodiscard]] const Eigen::Vector3d& origin() const { return origin_; }
  /// Size of the map's bounds [m].
  [[nodiscard]] const Eigen::Vector3d& extent() const { return extent_; }
  /// Coarse to fine.
  [[nodiscard]] const std::vector<Level>& levels() const { return levels_; }
  [[nodiscard]] std::size_t voxel_count() const;

 private:
  MapIndex();
  template <typename ForEachPoint>
  [[nodiscard]] static std::shared_ptr<const MapIndex> build_from(
      const ForEachPoint& for_each_point, const std::string& source,
      const MapIndexOptions& options);
  Eigen::Vector3d origin_;
  Eigen::Vector3d extent_;
  std::vector<Level> levels_;
};

}  // namespace stillmap::localization
