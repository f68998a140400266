#include "formats/bin.hpp"

#include <stillmap/maps/error.hpp>

#include <bit>
#include <cstring>

#include "formats/point_table.hpp"

namespace stillmap::maps {

static_assert(std::endian::native == std::endian::little, "scans are copied as they lie in files");

DecodedScan decode_bin(std::span<const std::byte> bytes, bool with_intensity,
                       const std::string& name, std::size_t max_points) {
  const std::size_t stride = (with_intensity ? 4 : 3) * sizeof(float);
  if (bytes.size() % stride != 0) {
    throw InputError(name, std::to_string(bytes.size()) + " bytes",
                     "a multiple of " + std::to_string(stride) + " (float32 x y z" +
                         (with_intensity ? " intensity)" : ")"));
  }
  DecodedScan scan;
  scan.points_in_file = bytes.size() / stride;
  check_point_count(scan.points_in_file, max_points, name);
  scan.cloud.positions.resize(scan.points_in_file);
  if (with_intensity) scan.cloud.intensities.resize(scan.points_in_file);
  const std::byte* point = bytes.data();
  for (std::size_t i = 0; i < scan.points_in_file; ++i, point += stride) {
    std::memcpy(scan.cloud.positions[i].data(), point, 3 * sizeof(float));
    if (with_intensity) {
      std::memcpy(&scan.cloud.intensities[i], point + 3 * sizeof(float), sizeof(float));
    }
  }
  scan.dropped = drop_invalid(scan.cloud);
  return scan;
}

}  // namespace stillmap::maps
