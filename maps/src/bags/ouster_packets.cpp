#include "bags/ouster_packets.hpp"

#include "formats/point_table.hpp"
#include "packets/ouster_sweep.hpp"

namespace stillmap::maps {

bool is_ouster_packet(std::string_view type) {
  return type == "ouster_ros/msg/PacketMsg" || type == "ouster_sensor_msgs/msg/PacketMsg" ||
         type == "ouster_msgs/msg/PacketMsg";
}

bool is_ouster_metadata(std::string_view topic, std::string_view type) {
  return type == "std_msgs/msg/String" && topic.ends_with("metadata");
}

std::optional<OusterPacketHead> read_ouster_head(MessageReader& reader) {
  const std::size_t bytes = reader.number<std::uint32_t>();
  if (bytes < kOusterHeadBytes) return std::nullopt;
  return ouster_packet_head(reader.array(kOusterHeadBytes), bytes);
}

DecodedScan decode_ouster_packets(const Bag& bag, std::span<const MessagePlace> packets,
                                  Serialization serialization, const OusterSensor& sensor,
                                  std::int64_t stamp_ns, const std::string& name,
                                  std::size_t max_points) {
  check_point_count(
      packets.size() * sensor.packet_columns * sensor.altitude_rad.size() * sensor.profile->returns,
      max_points, name);
  OusterSweep sweep(sensor, stamp_ns, name);
  for (const MessagePlace& place : packets) {
    const FileBytes message = bag.read(place);
    MessageReader reader(message.span(), serialization, name);
    sweep.add(reader.bytes());
  }
  return std::move(sweep).finish();
}

}  // namespace stillmap::maps
