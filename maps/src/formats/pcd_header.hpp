#pragma once

#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/point_table.hpp"

namespace stillmap::maps {

enum class PcdEncoding { kAscii, kBinary, kBinaryCompressed };

/// The header of a PCD file.
struct PcdHeader {
  std::vector<PointField> fields;
  std::size_t points = 0;
  PcdEncoding encoding = PcdEncoding::kAscii;
  /// Of the first byte behind the header.
  std::size_t body = 0;
  std::size_t lines = 0;
  /// VIEWPOINT: where the sensor stood; nothing where the file does not say it, or in no seven
  /// finite numbers that are a pose.
  std::optional<Eigen::Isometry3d> viewpoint;

  /// Bytes of one point.
  [[nodiscard]] std::size_t stride(bool with_padding) const {
    std::size_t bytes = 0;
    for (const PointField& field : fields) {
      if (with_padding || field.name != "_") bytes += field.count * size_of(field.type);
    }
    return bytes;
  }
};

/// What one side of a grid may have, and a file's points where nothing else bounds them.
inline constexpr std::uint64_t kMostPcdPoints = std::uint64_t{1} << 31U;

/// @param text  the file's beginning, in which the header must lie.
/// @throws InputError naming `name`, the value found and what was expected.
[[nodiscard]] PcdHeader parse_pcd_header(std::string_view text, const std::string& name,
                                         std::size_t max_points);

}  // namespace stillmap::maps
