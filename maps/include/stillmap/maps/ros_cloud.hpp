#pragma once

#include <stillmap/maps/scan_file.hpp>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace stillmap::maps {

/// Whose bytes a message is made of: ROS 1 packs its values, ROS 2 writes CDR.
enum class RosVersion : std::uint8_t { kRos1, kRos2 };

/// A scan as a ROS topic brought it.
struct RosCloud {
  std::int64_t stamp_ns = 0;
  /// Without the slash that ROS 1 put before it.
  std::string frame_id;
  DecodedScan scan;
};

/// Decodes a message as bags are read: fields of any order and type, times of points in any unit.
/// @param type  in ROS 1 or 2: `sensor_msgs/PointCloud2`, the `CustomMsg` of Livox' drivers,
/// `velodyne_msgs/VelodyneScan`.
/// @param message  as ROS sent it, without a length before it.
/// @param name  for messages of errors, such as the topic.
/// @throws InputError for another type or a message that cannot be read.
[[nodiscard]] RosCloud decode_ros_cloud(std::string_view type, RosVersion ros,
                                        std::span<const std::byte> message,
                                        const std::string& name);

}  // namespace stillmap::maps
