#include "bags/velodyne_scan.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>

#include "bags/ros_messages.hpp"
#include "formats/point_table.hpp"
#include "packets/velodyne_sweep.hpp"

namespace stillmap::maps {
namespace {

constexpr std::size_t kLeastBytesOfPacket = 8 + kVelodynePacketBytes;

}  // namespace

DecodedScan decode_velodyne_scan(MessageReader& reader, std::span<const VelodyneLaser> lasers,
                                 std::size_t max_points) {
  const RosHeader header = read_header(reader);
  const std::size_t packets = reader.count(kLeastBytesOfPacket);
  check_point_count(std::uint64_t{kVelodynePacketPoints} * packets, max_points, reader.name());
  VelodyneSweep sweep(lasers, reader.name());
  std::int64_t zero_ns = header.stamp_ns;
  for (std::size_t i = 0; i < packets; ++i) {
    const std::int64_t stamp_ns = read_time(reader);
    const double from_header_s = 1e-9 * static_cast<double>(stamp_ns - header.stamp_ns);
    if (i == 0 && std::abs(from_header_s) > static_cast<double>(kMaxTimeOffsetS))
      zero_ns = stamp_ns;
    sweep.add(reader.array(kVelodynePacketBytes), 1e-9 * static_cast<double>(stamp_ns - zero_ns));
  }
  DecodedScan scan = std::move(sweep).finish();
  for (const float t : scan.cloud.time_offsets_s) {
    if (std::abs(t) <= kMaxTimeOffsetS) continue;
    scan.cloud.time_offsets_s.clear();
    scan.times_note = fmt::format(
        "the times of points are left out: a packet of the scan lies {:.1f} s from its stamp", t);
    break;
  }
  return scan;
}

std::vector<std::string> fields_of_velodyne_scan(MessageReader& reader) {
  (void)read_header(reader);
  return {fmt::format("packets {} x {}", reader.count(kLeastBytesOfPacket), kVelodynePacketBytes)};
}

}  // namespace stillmap::maps
