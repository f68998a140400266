#pragma once

#include <stillmap/mapping/progress.hpp>
#include <stillmap/mapping/projection.hpp>
#include <stillmap/maps/drive.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

struct MapBuildOptions {
  maps::Selection selection;
  /// Poses instead of the drive's own.
  std::optional<std::filesystem::path> poses_file;
  /// `geometric` or `boxes:FILE`.
  std::string detector = "geometric";
  ProjectionOptions projection;
  /// Edge of the voxels that merge points of the map [m], in [0.02, 2].
  double voxel_size_m = 0.1;
  /// Points nearer are the vehicle itself (bonnet and tail of a car reach 2.5 m from a sensor on
  /// its roof), farther ones too sparse [m]; both are dropped and counted. In [0, 20] and [5, 300],
  /// the second larger.
  double min_range_m = 2.7;
  double max_range_m = 80.0;
  /// In [0, 256], 0 = all cores.
  int threads = 0;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// What a build did; the same numbers stand in the manifest (`counts`) and in build.json.
struct MapBuildReport {
  std::size_t scans = 0;
  double seconds = 0.0;
  double scans_per_second = 0.0;
  double peak_rss_mib = 0.0;
  std::map<std::string, std::uint64_t> points;  ///< in, ground, projected, deleted, static, ...
  std::map<std::string, std::uint64_t>
      objects;                                  ///< parked, moving, brief, boxes, "dropped: REASON"
  std::map<std::string, double> stage_seconds;  ///< summed over threads
  std::string digest;
};

/// Drive -> projected static map package at `target`, in bounded memory for the scans.
///
/// read -> drop -> deskew -> ground -> detect -> project (in parallel, a scan each), then stack in
/// the order of the scans, so that the bytes do not depend on the number of threads. A build that
/// fails or is cancelled leaves nothing at `target`.
/// @throws std::invalid_argument (options), maps::InputError, maps::StorageError, Cancelled.
MapBuildReport build_map(const std::filesystem::path& drive, const std::filesystem::path& target,
                         const MapBuildOptions& options, const ProgressCallback& progress,
                         const CancelFlag& cancel);

/// The object of `--json` and of a package's build.json.
[[nodiscard]] std::string to_json(const MapBuildReport& report);

}  // namespace stillmap::mapping
