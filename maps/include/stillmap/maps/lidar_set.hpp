#pragma once

#include <Eigen/Geometry>

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// Name of the file that makes a folder a drive of several lidars.
inline constexpr std::string_view kLidarSetFile = "lidars.json";
/// That it names.
inline constexpr std::size_t kMostLidars = 16;

/// One lidar of a vehicle with several.
struct MountedLidar {
  /// Its drive: a folder or a bag beside the file, with what follows `?`. No path.
  std::string drive;
  /// Identity for the first one, the reference.
  Eigen::Isometry3d T_reference_lidar = Eigen::Isometry3d::Identity();
  /// Added to its stamps to get those of the reference's clock [s]; within 1 s.
  double time_offset_s = 0.0;

  friend bool operator==(const MountedLidar& a, const MountedLidar& b) {
    return a.drive == b.drive && a.T_reference_lidar.isApprox(b.T_reference_lidar, 1e-12) &&
           a.time_offset_s == b.time_offset_s;
  }
};

/// `maps/drives.md` has an example.
/// @return 2 to `kMostLidars`, the reference first.
/// @throws InputError naming the file, the place in it and the value; StorageError.
[[nodiscard]] std::vector<MountedLidar> read_lidar_set(const std::filesystem::path& file);

/// What `read_lidar_set` reads.
[[nodiscard]] std::string lidar_set_text(const std::vector<MountedLidar>& lidars);

}  // namespace stillmap::maps
