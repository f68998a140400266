#pragma once

#include <stillmap/maps/geodesy.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// One point of a map that another program made.
struct CloudPoint {
  /// In the file's own frame [m], all finite.
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  /// In the file's own scale; 0 when there is none.
  float intensity = 0.0F;
};

/// What a file of such a map holds.
struct CloudSummary {
  std::uint64_t points_in_file = 0;
  /// Left out.
  std::uint64_t non_finite = 0;
  /// Columns by the names in the file; of LAS its point format.
  std::vector<std::string> fields;
  /// Whether a coordinate was stored in 32 bits of a floating type.
  bool single_precision = false;
  /// LAS: withheld or classified as noise, left out.
  std::uint64_t withheld = 0;
  /// Name of the coordinate system, and of that of the heights; empty where the file has none.
  std::string coordinates, heights;
  /// Of easting and northing, where the coordinates are those.
  std::optional<UtmZone> utm;
  /// PCD: where the sensor stood, which is not applied; nothing where the file does not say it.
  std::optional<Eigen::Isometry3d> viewpoint;
};

/// Bytes of a file that its header must lie in.
inline constexpr std::size_t kMostCloudHeaderBytes = 65536;

/// Checks the header alone: whether `read_cloud_file` can take a file that begins like this.
/// @param head    the first `kMostCloudHeaderBytes`, or all of a shorter file.
/// @param format  "pcd", "ply" or "las". @param name  what messages call it.
/// @throws InputError as `read_cloud_file`; std::invalid_argument for another format.
void check_cloud_header(std::span<const std::byte> head, std::string_view format,
                        const std::string& name);

/// Reads a PCD, PLY or LAS (1.0 to 1.4, uncompressed) file of any size in doubles and hands its
/// points on, in order, some tens of thousands at a time. The file is mapped, and of it some
/// millions of points are held at once; the viewpoint of a PCD is not applied. Columns as
/// `decode_scan` takes them; the intensity of LAS is that of the file. The format follows from the
/// extension.
/// @throws InputError naming the file, the value found and what was expected; StorageError when it
/// cannot be read; what `take` throws.
CloudSummary read_cloud_file(const std::filesystem::path& file,
                             const std::function<void(std::span<const CloudPoint>)>& take);

}  // namespace stillmap::maps
