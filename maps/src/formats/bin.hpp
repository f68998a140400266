#pragma once

#include <stillmap/maps/scan_file.hpp>

namespace stillmap::maps {

/// Raw little-endian float32.
/// @param format  one of the three of `raw_point_bytes`.
/// @throws InputError if the size is not a whole number of points, there are too many, or a point's
/// time is none.
[[nodiscard]] DecodedScan decode_bin(std::span<const std::byte> bytes, ScanFormat format,
                                     const std::string& name, std::size_t max_points);

}  // namespace stillmap::maps
