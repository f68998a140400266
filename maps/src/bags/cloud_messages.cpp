#include "bags/cloud_messages.hpp"

#include "bags/livox_cloud.hpp"
#include "bags/point_cloud2.hpp"
#include "bags/ros_messages.hpp"
#include "bags/velodyne_scan.hpp"

namespace stillmap::maps {

const CloudType* cloud_type(std::string_view type) {
  using Lasers = std::span<const VelodyneLaser>;
  static constexpr CloudType kPoints{
      [](MessageReader& reader, Lasers) { return decode_point_cloud2(reader); },
      fields_of_point_cloud2};
  static constexpr CloudType kLivox{
      [](MessageReader& reader, Lasers) { return decode_livox_cloud(reader); },
      fields_of_livox_cloud};
  static constexpr CloudType kVelodyne{
      [](MessageReader& reader, Lasers lasers) { return decode_velodyne_scan(reader, lasers); },
      fields_of_velodyne_scan};
  if (type == kPointCloud2) return &kPoints;
  if (is_livox_type(type)) return &kLivox;
  return type == kVelodyneScan ? &kVelodyne : nullptr;
}

}  // namespace stillmap::maps
