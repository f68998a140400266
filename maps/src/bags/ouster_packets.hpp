#pragma once

#include <stillmap/maps/scan_file.hpp>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "bags/bag.hpp"
#include "bags/message_reader.hpp"
#include "packets/ouster_sensor.hpp"

namespace stillmap::maps {

/// The frame of the points (`OusterSweep`), as Ouster's driver calls it; the packets name none.
inline constexpr const char* kOusterFrame = "os_sensor";
/// Of an Ouster's packets no message is longer.
inline constexpr std::size_t kMostMetadataBytes = std::size_t{1} << 20U;

/// `PacketMsg` of Ouster's drivers for ROS 1 and 2: `uint8[] buf`, a packet each, without a stamp.
/// Source: https://github.com/ouster-lidar/ouster-ros
[[nodiscard]] bool is_ouster_packet(std::string_view type);

/// Bytes of such a message that `read_ouster_head` needs.
inline constexpr std::size_t kOusterMessageHeadBytes = 4 + 4 + kOusterHeadBytes;

/// @return nothing for a packet that is not of the lidar. @throws InputError for a cut message.
[[nodiscard]] std::optional<OusterPacketHead> read_ouster_head(MessageReader& reader);

/// The sensor's own description, as the driver sends it on a topic `metadata`.
[[nodiscard]] bool is_ouster_metadata(std::string_view topic, std::string_view type);

/// The packets of a turn of the sensor, in their order.
struct OusterTurn {
  std::span<const MessagePlace> packets;
  Serialization serialization = Serialization::kCdr;
  /// Of the scan, by the sensor's clock.
  std::int64_t stamp_ns = 0;
  /// For messages.
  std::string name;
};

/// @throws InputError for packets of another sensor or too many of them, or a bag that changed.
[[nodiscard]] DecodedScan decode_ouster_turn(const Bag& bag, const OusterTurn& turn,
                                             const OusterSensor& sensor,
                                             std::size_t max_points = 4'000'000);

}  // namespace stillmap::maps
