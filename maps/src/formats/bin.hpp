#pragma once

#include <stillmap/maps/scan_file.hpp>

namespace stillmap::maps {

/// Raw little-endian float32: x y z, and intensity with `with_intensity`.
/// @throws InputError if the size is not a whole number of points, or there are too many.
[[nodiscard]] DecodedScan decode_bin(std::span<const std::byte> bytes, bool with_intensity,
                                     const std::string& name, std::size_t max_points);

}  // namespace stillmap::maps
