#pragma once

#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/geodesy.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

struct MapImportOptions {
  /// Name of the map's frame; 1 to 64 bytes of printable text. None: `enu` where its place on the
  /// Earth is known, else `local`.
  std::optional<std::string> frame_id;
  /// Where the map's frame lies. Of coordinates in UTM: the frame that they are taken to, rather
  /// than one in the middle of the points. Of others: the place of their zero, x east, y north.
  std::optional<maps::GeodeticOrigin> geodetic_origin;
  /// Coordinates are easting, northing and height above the ellipsoid in this zone, which the file
  /// itself need not say.
  std::optional<maps::UtmZone> utm;
  /// Axis of the file's coordinates that points up: x, -x, y, -y, z or -z. LOAM's camera axes have
  /// y up, a camera's of KITTI -y. Others than z are turned, and have no place in UTM.
  std::string up = "z";
  /// As in `MapBuildOptions`, in [0.02, 2].
  double voxel_size_m = 0.1;
  /// In [0, 256], 0 = all cores.
  int threads = 0;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// What an import did; the counts stand in the manifest too.
struct MapImportResult {
  /// in, dropped_non_finite, dropped_withheld, dropped_too_far, ground, static, places.
  std::map<std::string, std::uint64_t> counts;
  double seconds = 0.0;
  double peak_rss_mib = 0.0;
  /// What a person should look at: coarse coordinates, no ground, points left out.
  std::vector<std::string> warnings;
  std::string digest;
};

/// A point cloud map from elsewhere (PCD, PLY or LAS, [m], or the folder of an Autoware map) -> a
/// package, in the coordinates of the file, turned where its z is not up. Where these are UTM, by
/// the file's word or the options', they are taken to a local frame (east-north-up), since a map in
/// UTM is bent and scaled.
///
/// Of an Autoware map all tiles are read. Its projector says where it lies (`read_autoware_map`):
/// in LocalCartesian coordinates stay; those of LocalCartesianUTM and TransverseMercator are taken
/// to the east-north-up frame at `map_origin`, those of MGRS to one in the middle of the points.
///
/// All points count as measured; those on the ground, where that is found, are marked so. The
/// package has no trajectory: a scan without a prior is looked for at `places`, on a 4 m grid of
/// free ground (mapping/registration.md). The file is read twice, in pieces; memory grows with the
/// map's area, voxels beyond 5 million wait on the disk.
/// @throws std::invalid_argument (options), maps::InputError for a file without points, one that
/// says another zone than the options, or one whose
/// coordinates are too large for the 32 bits that they are stored in; maps::StorageError;
/// Cancelled.
MapImportResult import_map(const std::filesystem::path& file, const std::filesystem::path& target,
                           const MapImportOptions& options, const ProgressCallback& progress,
                           const CancelFlag& cancel);

/// The object of `--json` and of a package's build.json.
[[nodiscard]] std::string to_json(const MapImportResult& result);

}  // namespace stillmap::mapping
