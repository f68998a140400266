#pragma once

#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/scan_file.hpp>

#include <Eigen/Geometry>

#include <filesystem>
#include <optional>

namespace stillmap::maps {

/// PCD 0.5 to 0.7. Fields other than x y z, intensity and time are skipped. The viewpoint is not
/// applied: by PCL's convention the points lie in the sensor's frame. Bytes behind the last point
/// are ignored, as PCL does.
/// @throws InputError naming `name`, the value found and what was expected.
[[nodiscard]] DecodedScan decode_pcd(std::span<const std::byte> bytes, const std::string& name,
                                     std::size_t max_points,
                                     std::optional<std::int64_t> stamp_ns = std::nullopt);

/// The same, handed on as it is read, in doubles. @throws as `decode_pcd`, and what `take` throws.
CloudSummary stream_pcd(std::span<const std::byte> bytes, const std::string& name,
                        const std::function<void(std::span<const CloudPoint>)>& take);

/// Where the header says that the sensor stood; nothing where it does not, also for a header that
/// is none. @throws StorageError.
[[nodiscard]] std::optional<Eigen::Isometry3d> read_pcd_viewpoint(
    const std::filesystem::path& file);

/// As `check_cloud_header`.
void check_pcd_header(std::span<const std::byte> head, const std::string& name);

}  // namespace stillmap::maps
