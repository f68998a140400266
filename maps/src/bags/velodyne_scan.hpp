#pragma once

#include <stillmap/maps/scan_file.hpp>

#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bags/message_reader.hpp"
#include "packets/velodyne_models.hpp"

namespace stillmap::maps {

inline constexpr std::string_view kVelodyneScan = "velodyne_msgs/msg/VelodyneScan";

/// A VelodyneScan of velodyne_driver: the packets of a sweep, each with the time at which it began.
/// Times of points count from the header's stamp, or, where packets are stamped by another clock,
/// from the first packet.
/// @param lasers  of the sensor's calibration, or empty (`VelodyneSweep`).
/// @throws InputError as `decode_point_cloud2` and `VelodyneSweep::add`.
[[nodiscard]] DecodedScan decode_velodyne_scan(MessageReader& reader,
                                               std::span<const VelodyneLaser> lasers = {},
                                               std::size_t max_points = 4'000'000);

/// "packets N x 1206". @throws as above.
[[nodiscard]] std::vector<std::string> fields_of_velodyne_scan(MessageReader& reader);

}  // namespace stillmap::maps
