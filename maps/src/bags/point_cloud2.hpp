#pragma once

#include <stillmap/maps/scan_file.hpp>

#include <cstddef>
#include <string>
#include <vector>

#include "bags/ros_messages.hpp"

namespace stillmap::maps {

/// Decodes `sensor_msgs/PointCloud2`: fields in any order and of any of its types, both byte
/// orders, padding of points and rows, organized or not. Columns as in `scan_file.hpp`; `count` 0
/// of a field, which some drivers leave, is taken as 1.
///
/// Times of points: whole numbers are nanoseconds from the message's stamp (Ouster's `t`, Livox's
/// `offset_time`, Autoware's `time_stamp`); floating ones are seconds from it (Velodyne's `time`)
/// or, where all lie within 1 s of the stamp so read, seconds, nanoseconds or microseconds since
/// the epoch (Hesai's and Robosense's `timestamp`, Livox's). The first reading in this order by
/// which all points lie within 1 s of the stamp counts; when there is none, all times are left out.
/// @param max_points  4 million keep a message of `kMostMessageBytes` and its points below 256 MiB.
/// @throws InputError naming the reader's name, the value found and what was expected.
[[nodiscard]] DecodedScan decode_point_cloud2(MessageReader& reader,
                                              std::size_t max_points = 4'000'000);

/// Its columns as "NAME TYPE", with "xCOUNT" where that is not 1.
/// @throws as above.
[[nodiscard]] std::vector<std::string> fields_of_point_cloud2(MessageReader& reader);

}  // namespace stillmap::maps
