#pragma once

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/region.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace stillmap::localization {

/// How a map is turned into voxels.
struct MapIndexOptions {
  /// Edge of the finest voxel [m], in [0.1, 4]. Finer is sharper near the end and slower to build.
  double finest_voxel_m = 0.5;
  /// Number of levels, each twice as coarse, in [1, 6]; the coarsest edge divides 160 m evenly.
  /// More widen the basin.
  int levels = 3;
  /// Voxels with fewer points than this carry no shape and are left out, >= 3.
  int min_points = 5;

  [[nodiscard]] std::vector<std::string> violations() const;
};

class IndexWindow;
struct IndexKey;
struct RootContent;
struct RootView;

/// Voxels with mean, covariance and normal at several resolutions, by regions of 640 m; what every
/// aligner of ours searches. A query looks into the region that it lies in and those around it,
/// through a window whose numbers count from that region's corner, so that floats keep their tenths
/// of millimetres wherever the region lies. Immutable to its users, safe from several threads. Only
/// `measured` points enter.
class MapIndex {
 public:
  /// Uses the files of a map's index as they lie: its root is read, and regions are memory-mapped
  /// when a query comes to them, and let go when others are asked for. Where there is no root, or
  /// it is broken or of another map, format or options, the regions that are not there are built,
  /// each from its own tiles, and the files are written. What cannot be
  /// written (a read-only disk, another process writing it just now) is kept in memory. Same
  /// answers to the last bit each way. The files lie in the package's folder `index/`, outside of
  /// its digest; the folder must stay while the index is used.
  /// @throws as `build`.
  [[nodiscard]] static std::shared_ptr<const MapIndex> open(const maps::MapPackage& map,
                                                            const MapIndexOptions& options = {});
  /// Gives a map that has no index yet the files of another version's, so that `open` builds those
  /// regions only whose tiles are others. They are the same files where the file system has hard
  /// links, else copies; what cannot be taken is built.
  static void begin_with(const maps::MapPackage& map, const maps::MapPackage& other,
                         const MapIndexOptions& options = {});
  /// Builds in memory, without a file.
  /// @throws std::invalid_argument on broken options, maps::InputError if no voxel has enough
  /// points, one is not finite, or farther than 10^9 m from the origin.
  [[nodiscard]] static std::shared_ptr<const MapIndex> build(const maps::MapPackage& map,
                                                             const MapIndexOptions& options = {});
  /// Same from points [m] in the map frame. @throws std::invalid_argument if one is not finite.
  [[nodiscard]] static std::shared_ptr<const MapIndex> build(
      const std::vector<Eigen::Vector3d>& points_map, const MapIndexOptions& options = {});
  struct Level;
  ~MapIndex();
  MapIndex(const MapIndex&) = delete;
  MapIndex& operator=(const MapIndex&) = delete;

  /// Where the regions begin, in the map frame [m]: at the map's origin, a little lower; of bare
  /// points at their lowest corner.
  [[nodiscard]] const Eigen::Vector3d& origin() const { return origin_; }
  /// Box around the map's points, in the map frame [m].
  [[nodiscard]] Eigen::AlignedBox3d bounds() const;
  [[nodiscard]] const MapIndexOptions& options() const { return options_; }
  /// Of all levels.
  [[nodiscard]] std::size_t voxel_count() const;
  /// Regions, places and errors of the map.
  [[nodiscard]] const RootView& root() const;

  /// The window for queries at a place in the map frame [m]; empty far from the map.
  /// @throws maps::InputError, maps::StorageError when a region has gone or is broken and cannot be
  /// built again.
  [[nodiscard]] std::shared_ptr<const IndexWindow> around(const Eigen::Vector3d& p_map) const;
  [[nodiscard]] std::shared_ptr<const IndexWindow> around(maps::RegionId region) const;

  /// The root's file; empty when the index is kept in memory.
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  /// Why `open` did not use the files as they lay (there were none, or what was wrong with the
  /// root); empty when it did.
  [[nodiscard]] const std::string& rebuilt_because() const { return rebuilt_because_; }
  /// Why `open` has kept what it built in memory; empty when it lies in files.
  [[nodiscard]] const std::string& kept_in_memory_because() const {
    return kept_in_memory_because_;
  }
  /// Reads every byte. Otherwise headers and directories alone are checked: damage elsewhere spoils
  /// answers there, but reaches no memory outside the index.
  /// @throws maps::InputError naming file and section that do not fit their checksum.
  void verify() const;

 private:
  class Regions;
  MapIndex(const Eigen::Vector3d& origin, const MapIndexOptions& options);
  void build_from(const maps::MapPackage& map);
  /// @param package  whose files it goes to, if any.
  void set_root(const RootContent& root, const IndexKey& key, const std::filesystem::path& package);

  Eigen::Vector3d origin_;
  MapIndexOptions options_;
  std::unique_ptr<Regions> regions_;
  std::filesystem::path file_;
  std::string rebuilt_because_;
  std::string kept_in_memory_because_;
};

}  // namespace stillmap::localization
