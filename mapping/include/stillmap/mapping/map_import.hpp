#pragma once

#include <stillmap/mapping/progress.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace stillmap::mapping {

struct MapImportOptions {
  /// Name of the frame that the points are in; 1 to 64 bytes of printable text.
  std::string frame_id = "local";
  /// As in `MapBuildOptions`, in [0.02, 2].
  double voxel_size_m = 0.1;
  /// In [0, 256], 0 = all cores.
  int threads = 0;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// What an import did; the counts stand in the manifest too.
struct MapImportReport {
  /// in, dropped_non_finite, dropped_too_far, ground, static, places.
  std::map<std::string, std::uint64_t> counts;
  double seconds = 0.0;
  double peak_rss_mib = 0.0;
  /// What a person should look at: coarse coordinates, no ground, points left out.
  std::vector<std::string> warnings;
  std::string digest;
};

/// A point cloud map from elsewhere (PCD or PLY, in map coordinates [m], z up) -> a package.
///
/// All points count as measured; those on the ground, where that is found, are marked so. The
/// package has no trajectory: a scan without a prior is looked for at `places`, on a 4 m grid of
/// free ground (mapping/registration.md). The file is read twice, in pieces; memory grows with the
/// map's area, voxels beyond 5 million wait on the disk.
/// @throws std::invalid_argument (options), maps::InputError for a file without points, or whose
/// coordinates are too large for the 32 bits that they are stored in; maps::StorageError;
/// Cancelled.
MapImportReport import_map(const std::filesystem::path& file, const std::filesystem::path& target,
                           const MapImportOptions& options, const ProgressCallback& progress,
                           const CancelFlag& cancel);

/// The object of `--json` and of a package's build.json.
[[nodiscard]] std::string to_json(const MapImportReport& report);

}  // namespace stillmap::mapping
