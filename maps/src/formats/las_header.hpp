#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "formats/crs.hpp"

namespace stillmap::maps {

/// What is needed of a LAS file before its points, all of it checked against the bytes at hand.
struct LasHeader {
  int minor_version = 0;
  /// In [0, 10].
  int point_format = 0;
  /// Bytes of a point, and of the first one's place.
  std::size_t point_bytes = 0;
  std::size_t first_point = 0;
  std::uint64_t points = 0;
  std::array<double, 3> scale{}, offset{};
  CoordinateSystem system;

  /// Formats 6 and above have 8 bits of class, and flags of their own.
  [[nodiscard]] bool is_extended() const { return point_format >= 6; }
};

/// Version, layout of a point and scale alone, of a file that begins so. @throws InputError.
[[nodiscard]] LasHeader read_las_start(std::span<const std::byte> bytes, const std::string& name);

/// @param bytes  the whole file.
/// @throws InputError naming `name`, the value found and what was expected: also for LAZ and COPC,
/// versions other than 1.0 to 1.4, and fewer points than the header says.
[[nodiscard]] LasHeader read_las_header(std::span<const std::byte> bytes, const std::string& name);

}  // namespace stillmap::maps
