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
/// Times of points: `formats/point_times.hpp`, with the message's stamp.
/// @param max_points  4 million keep a message of `kMostMessageBytes` and its points below 256 MiB.
/// @throws InputError naming the reader's name, the value found and what was expected.
[[nodiscard]] DecodedScan decode_point_cloud2(MessageReader& reader,
                                              std::size_t max_points = 4'000'000);

/// Its columns as "NAME TYPE", with "xCOUNT" where that is not 1.
/// @throws as above.
[[nodiscard]] std::vector<std::string> fields_of_point_cloud2(MessageReader& reader);

}  // namespace stillmap::maps
