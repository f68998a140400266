#include "bags/livox_cloud.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>

#include "formats/point_table.hpp"

namespace stillmap::maps {
namespace {

/// Packed, as in ROS 1; CDR adds a byte.
constexpr std::size_t kLeastPointBytes = 4 + 3 * 4 + 3;
constexpr std::int64_t kNsPerS = 1'000'000'000;

/// What stands before the points.
struct LivoxHead {
  RosHeader header;
  /// Of the first point, by the lidar's clock.
  std::uint64_t timebase_ns = 0;
  std::size_t points = 0;
};

LivoxHead read_livox_head(MessageReader& reader) {
  LivoxHead head;
  head.header = read_header(reader);
  head.timebase_ns = reader.number<std::uint64_t>();
  (void)reader.number<std::uint32_t>();  // the count, which the sequence has too
  for (int i = 0; i < 4; ++i) (void)reader.number<std::uint8_t>();  // lidar and reserve
  head.points = reader.count(kLeastPointBytes);
  return head;
}

/// From the header's stamp to the timebase [ns]; 0 where these are of different clocks.
std::int64_t from_stamp_to_timebase_ns(const LivoxHead& head) {
  const auto timebase_ns = static_cast<std::int64_t>(head.timebase_ns);
  std::int64_t apart_ns = 0;
  if (__builtin_sub_overflow(timebase_ns, head.header.stamp_ns, &apart_ns)) return 0;
  return apart_ns >= -kNsPerS && apart_ns <= kNsPerS ? apart_ns : 0;
}

bool is_sure(std::uint8_t tag) { return (tag >> 4U & 3U) < 2; }

}  // namespace

bool is_livox_type(std::string_view type) {
  return type == "livox_ros_driver/msg/CustomMsg" || type == "livox_ros_driver2/msg/CustomMsg" ||
         type == "livox_interfaces/msg/CustomMsg";
}

DecodedScan decode_livox_cloud(MessageReader& reader, std::size_t max_points) {
  const LivoxHead head = read_livox_head(reader);
  check_point_count(head.points, max_points, reader.name());
  const std::int64_t timebase_ns = from_stamp_to_timebase_ns(head);
  DecodedScan scan;
  PointCloud& cloud = scan.cloud;
  scan.points_in_file = head.points;
  cloud.positions.resize(head.points);
  cloud.intensities.resize(head.points);
  std::vector<std::int64_t> times_ns(head.points);
  std::vector<std::uint8_t> sure(head.points);
  for (std::size_t i = 0; i < head.points; ++i) {
    times_ns[i] = timebase_ns + reader.number<std::uint32_t>();
    for (float& value : cloud.positions[i]) value = reader.number<float>();
    cloud.intensities[i] = static_cast<float>(reader.number<std::uint8_t>());
    sure[i] = is_sure(reader.number<std::uint8_t>()) ? 1 : 0;
    (void)reader.number<std::uint8_t>();  // the laser
  }
  scan.dropped.unsure = static_cast<std::size_t>(std::ranges::count(sure, 0));
  if (scan.dropped.unsure > 0) cloud.keep_only(sure);
  scan.dropped += drop_invalid(cloud);
  for (std::size_t i = 0; i < cloud.size(); ++i)
    cloud.time_offsets_s.push_back(
        static_cast<float>(1e-9 * static_cast<double>(times_ns[cloud.file_index(i)])));
  const auto is_near = [](float t) { return std::abs(t) <= kMaxTimeOffsetS; };
  if (!std::ranges::all_of(cloud.time_offsets_s, is_near)) {
    cloud.time_offsets_s.clear();
    scan.times_note = "the times of points in 'offset_time' are left out: they go beyond 1 s";
  }
  return scan;
}

std::uint8_t read_livox_lidar(MessageReader& reader) {
  (void)reader.number<std::uint64_t>();  // timebase
  (void)reader.number<std::uint32_t>();  // count
  return reader.number<std::uint8_t>();
}

std::vector<std::string> fields_of_livox_cloud(MessageReader& reader) {
  (void)read_livox_head(reader);
  return {"offset_time u32", "x f32", "y f32", "z f32", "reflectivity u8", "tag u8", "line u8"};
}

}  // namespace stillmap::maps
