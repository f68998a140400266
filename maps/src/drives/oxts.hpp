#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// Lines `2011-09-26 13:10:51.158069617` to ns since the Unix epoch, without loss; no zone is
/// given, UTC is taken.
/// @return one for each line; nothing for a blank line, which drives with a lost scan have (0009 of
/// 2011_09_26).
/// @throws InputError naming file, line and value.
[[nodiscard]] std::vector<std::optional<std::int64_t>> read_kitti_stamps(
    const std::filesystem::path& file);

/// Path of the GPS/IMU unit in its own frame.
struct OxtsPath {
  /// T_map_imu by stamp: east-north-up at `origin`, imu x forward, y left, z up.
  std::vector<StampedPose> T_map_imu;
  GeodeticOrigin origin;
  std::vector<std::string> notes;
};

/// Reads `data/*.txt` and `timestamps.txt` of an `oxts` folder; the first position becomes the
/// origin.
/// @throws InputError naming file and value.
[[nodiscard]] OxtsPath read_oxts(const std::filesystem::path& folder);

}  // namespace stillmap::maps
