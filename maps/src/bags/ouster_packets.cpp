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

DecodedScan decode_ouster_turn(const Bag& bag, const OusterTurn& turn, const OusterSensor& sensor,
                               std::size_t max_points) {
  const std::size_t pixels = sensor.packet_columns * sensor.altitude_rad.size();
  check_point_count(turn.packets.size() * pixels * sensor.profile->returns, max_points, turn.name);
  OusterSweep sweep(sensor, turn.stamp_ns, turn.name);
  for (const MessagePlace& place : turn.packets) {
    const FileBytes message = bag.read(place);
    MessageReader reader(message.span(), turn.serialization, turn.name);
    sweep.add(reader.bytes());
  }
  return std::move(sweep).finish();
}

}  // namespace stillmap::maps
