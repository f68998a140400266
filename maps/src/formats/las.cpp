#include "formats/las.hpp"

#include <stillmap/maps/error.hpp>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include "formats/cloud_stream.hpp"
#include "formats/las_header.hpp"

namespace stillmap::maps {
namespace {

// Classes of the ASPRS.
constexpr unsigned kLowNoise = 7;
constexpr unsigned kHighNoise = 18;

template <typename Number>
Number read_as(const std::byte* bytes) {
  Number number;
  std::memcpy(&number, bytes, sizeof number);
  return number;
}

/// Withheld means deleted.
bool is_left_out(const std::byte* point, const LasHeader& header) {
  const auto flags = std::to_integer<unsigned>(point[15]);
  if (!header.is_extended()) return (flags & 0x80U) != 0 || (flags & 0x1FU) == kLowNoise;
  const auto of_class = std::to_integer<unsigned>(point[16]);
  return (flags & 0x04U) != 0 || of_class == kLowNoise || of_class == kHighNoise;
}

CloudPoint point_at(const std::byte* bytes, const LasHeader& header) {
  CloudPoint point;
  for (std::size_t axis = 0; axis < 3; ++axis)
    point.position[static_cast<Eigen::Index>(axis)] =
        read_as<std::int32_t>(bytes + 4 * axis) * header.scale[axis] + header.offset[axis];
  point.intensity = read_as<std::uint16_t>(bytes + 12);
  return point;
}

/// Metres are all that a map is in.
void require_metres(const CoordinateSystem& system, const std::string& name) {
  if (system.is_geographic)
    throw InputError(name, "longitude and latitude (" + system.name + ")",
                     "metres, e.g. UTM: `pdal translate IN.las OUT.las reprojection`");
  for (const std::optional<double>& unit :
       {system.metres_per_unit, system.vertical_metres_per_unit}) {
    if (unit && std::abs(*unit - 1.0) > 1e-9)
      throw InputError(name, "units of " + std::to_string(*unit) + " m (" + system.name + ")",
                       "metres, e.g. UTM: `pdal translate IN.las OUT.las reprojection`");
  }
}

}  // namespace

void check_las_header(std::span<const std::byte> head, const std::string& name) {
  static_cast<void>(read_las_start(head, name));
}

CloudSummary stream_las(std::span<const std::byte> bytes, const std::string& name,
                        const std::function<void(std::span<const CloudPoint>)>& take) {
  const LasHeader header = read_las_header(bytes, name);
  require_metres(header.system, name);
  CloudSummary summary;
  summary.points_in_file = header.points;
  summary.fields = {"LAS 1." + std::to_string(header.minor_version) + " point format " +
                    std::to_string(header.point_format)};
  summary.coordinates = header.system.name;
  summary.heights = header.system.vertical_name;
  summary.utm = header.system.utm;
  std::vector<CloudPoint> points;
  points.reserve(std::min<std::uint64_t>(header.points, kRowsAtOnce));
  const std::byte* at = bytes.data() + header.first_point;
  for (std::uint64_t i = 0; i < header.points; ++i, at += header.point_bytes) {
    if (is_left_out(at, header))
      ++summary.withheld;
    else
      points.push_back(point_at(at, header));
    if (points.size() < kRowsAtOnce && i + 1 < header.points) continue;
    if (!points.empty()) take(points);
    points.clear();
  }
  return summary;
}

}  // namespace stillmap::maps
