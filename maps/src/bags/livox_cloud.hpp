#pragma once

#include <stillmap/maps/scan_file.hpp>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "bags/message_reader.hpp"
#include "bags/ros_messages.hpp"

namespace stillmap::maps {

/// Whether a topic holds Livox' own clouds, by the names of its three drivers: livox_ros_driver
/// (ROS 1), livox_ros2_driver and livox_ros_driver2 (both).
[[nodiscard]] bool is_livox_type(std::string_view type);

/// A CustomMsg, whose layout is the same in all drivers: header, timebase [ns], count, lidar and
/// reserve, then for each point its time behind the timebase [ns], x y z [m], reflectivity, tag and
/// line.
///
/// Times of points count from the header's stamp. Where the timebase lies more than 1 s from it,
/// the clocks differ, and the stamp is taken for the timebase.
///
/// By their tag, points of the third and fourth echo (Mid, Avia, Horizon, Tele) or of the least
/// confidence (HAP, Mid-360) are left out and counted: bits 4 and 5 above 1, as FAST-LIO does.
/// @throws InputError as `decode_point_cloud2`.
[[nodiscard]] DecodedScan decode_livox_cloud(MessageReader& reader,
                                             std::size_t max_points = 4'000'000);

/// The lidar that a CustomMsg names: drivers with multi_topic 0 put those of all lidars on one
/// topic.
/// @param reader  behind the header. @throws as above.
[[nodiscard]] std::uint8_t read_livox_lidar(MessageReader& reader);

/// "offset_time u32", ... @throws as above.
[[nodiscard]] std::vector<std::string> fields_of_livox_cloud(MessageReader& reader);

}  // namespace stillmap::maps
