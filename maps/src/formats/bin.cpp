#include "formats/bin.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstring>

#include "formats/point_table.hpp"

namespace stillmap::maps {

static_assert(std::endian::native == std::endian::little, "scans are copied as they lie in files");

namespace {

void require_times(const PointCloud& cloud, const std::string& name) {
  for (std::size_t i = 0; i < cloud.time_offsets_s.size(); ++i) {
    if (std::abs(cloud.time_offsets_s[i]) <= kMaxTimeOffsetS) continue;
    throw InputError(
        name, fmt::format("point {} at {} s", cloud.file_index(i), cloud.time_offsets_s[i]),
        fmt::format("within {} s of the scan's stamp: write times that count from this stamp",
                    kMaxTimeOffsetS));
  }
}

}  // namespace

DecodedScan decode_bin(std::span<const std::byte> bytes, ScanFormat format, const std::string& name,
                       std::size_t max_points) {
  const std::size_t stride = raw_point_bytes(format);
  const std::size_t floats = stride / sizeof(float);
  if (bytes.size() % stride != 0) {
    throw InputError(
        name, std::to_string(bytes.size()) + " bytes",
        fmt::format("a multiple of {} (float32 x y z{}{}): copy the file again, or check which "
                    "numbers it holds",
                    stride, floats > 3 ? " intensity" : "", floats > 4 ? " time" : ""));
  }
  DecodedScan scan;
  scan.points_in_file = bytes.size() / stride;
  check_point_count(scan.points_in_file, max_points, name);
  scan.cloud.positions.resize(scan.points_in_file);
  if (floats > 3) scan.cloud.intensities.resize(scan.points_in_file);
  if (floats > 4) scan.cloud.time_offsets_s.resize(scan.points_in_file);
  const std::byte* point = bytes.data();
  for (std::size_t i = 0; i < scan.points_in_file; ++i, point += stride) {
    std::memcpy(scan.cloud.positions[i].data(), point, 3 * sizeof(float));
    if (floats > 3)
      std::memcpy(&scan.cloud.intensities[i], point + 3 * sizeof(float), sizeof(float));
    if (floats > 4)
      std::memcpy(&scan.cloud.time_offsets_s[i], point + 4 * sizeof(float), sizeof(float));
  }
  scan.dropped = drop_invalid(scan.cloud);
  require_times(scan.cloud, name);
  return scan;
}

}  // namespace stillmap::maps
