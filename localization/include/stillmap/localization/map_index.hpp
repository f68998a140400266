#pragma once

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <filesystem>
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

class CellBits;
class OwnError;
struct IndexKey;

/// Voxels with mean, covariance and normal at several resolutions; what every aligner of ours
/// searches. Immutable, safe from several threads. Only `measured` points enter; coordinates are
/// relative to `origin()` so that floats keep their millimetres.
class MapIndex {
 public:
  /// Uses the index file of a map as it lies, memory-mapped: nothing is built, and pages are read
  /// when a query touches them. Where there is no such file, or it is broken or of another map,
  /// format or options, the index is built and the file written; where that is not possible
  /// either (a read-only disk, another process writing it just now) the index is kept in memory.
  /// Same answers to the last bit each way. The file lies in the package's folder `index/`, outside
  /// of its digest.
  /// @throws as `build`.
  [[nodiscard]] static std::shared_ptr<const MapIndex> open(const maps::MapPackage& map,
                                                            const MapIndexOptions& options = {});
  /// Builds in memory, without a file.
  /// @throws std::invalid_argument on broken options, maps::InputError if no voxel has enough
  /// points, one is not finite, or they lie too far apart.
  [[nodiscard]] static std::shared_ptr<const MapIndex> build(const maps::MapPackage& map,
                                                             const MapIndexOptions& options = {});
  /// Same from points [m] in the map frame. @throws std::invalid_argument if one is not finite.
  [[nodiscard]] static std::shared_ptr<const MapIndex> build(
      const std::vector<Eigen::Vector3d>& points_map, const MapIndexOptions& options = {});
  struct Level;
  ~MapIndex();
  MapIndex(const MapIndex&) = delete;
  MapIndex& operator=(const MapIndex&) = delete;
  /// Corner of the map's bounds with the smallest coordinates, in the map frame [m].
  [[nodiscard]] const Eigen::Vector3d& origin() const { return origin_; }
  /// Size of the map's bounds [m].
  [[nodiscard]] const Eigen::Vector3d& extent() const { return extent_; }
  /// Coarse to fine.
  [[nodiscard]] const std::vector<Level>& levels() const { return levels_; }
  /// Occupied columns for the search without a prior, from wide to fine.
  [[nodiscard]] const std::vector<CellBits>& place_grids() const { return place_grids_; }
  /// How far the map is bent or torn, by place; of points alone nothing is known.
  [[nodiscard]] const OwnError& own_error() const { return *own_error_; }
  [[nodiscard]] std::size_t voxel_count() const;

  /// The mapped file; empty when the index is kept in memory.
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  /// Why `open` did not use a file as it lay (there was none, or what was wrong with it); empty
  /// when it did.
  [[nodiscard]] const std::string& rebuilt_because() const { return rebuilt_because_; }
  /// Why `open` has not mapped the file that it built; empty when it has.
  [[nodiscard]] const std::string& kept_in_memory_because() const {
    return kept_in_memory_because_;
  }
  /// Reads every byte. `open` checks the header and the directories alone: damage elsewhere spoils
  /// answers there, but reaches no memory outside the index.
  /// @throws maps::InputError naming file and section that do not fit their checksum.
  void verify() const;

 private:
  struct Storage;
  MapIndex(std::unique_ptr<const Storage> storage, const IndexKey& key, const std::string& name);
  [[nodiscard]] static std::shared_ptr<MapIndex> map_file(const std::filesystem::path& file,
                                                          const IndexKey& key);
  [[nodiscard]] static std::shared_ptr<MapIndex> open_voxels(const maps::MapPackage& map,
                                                             const MapIndexOptions& options);
  [[nodiscard]] std::string name() const;

  std::unique_ptr<const Storage> storage_;
  Eigen::Vector3d origin_;
  Eigen::Vector3d extent_;
  std::vector<Level> levels_;
  std::vector<CellBits> place_grids_;
  std::unique_ptr<const OwnError> own_error_;
  std::filesystem::path file_;
  std::string rebuilt_because_;
  std::string kept_in_memory_because_;
};

}  // namespace stillmap::localization
