#include <stillmap/maps/error.hpp>
#include <stillmap/maps/ros_cloud.hpp>

#include "bags/bag.hpp"
#include "bags/cloud_messages.hpp"
#include "bags/ros_messages.hpp"

namespace stillmap::maps {

RosCloud decode_ros_cloud(std::string_view type, RosVersion ros, std::span<const std::byte> message,
                          const std::string& name) {
  const CloudType* const clouds = cloud_type(ros2_type(std::string(type)));
  if (clouds == nullptr)
    throw InputError(name, "messages of type '" + std::string(type) + "'",
                     "scans: sensor_msgs/PointCloud2, a CustomMsg of Livox or a VelodyneScan");
  const auto serialization = ros == RosVersion::kRos1 ? Serialization::kRos1 : Serialization::kCdr;
  MessageReader head(message, serialization, name);
  RosHeader header = read_header(head);
  MessageReader body(message, serialization, name);
  return {header.stamp_ns, std::move(header.frame_id), clouds->decode(body, {})};
}

}  // namespace stillmap::maps
