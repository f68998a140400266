#pragma once

#include <stillmap/maps/scan_file.hpp>

#include <optional>
#include <string_view>

namespace stillmap::maps {

/// Raw little-endian float32.
/// @param columns  of a point, as `ScanFileHints::bin_columns`.
/// @throws InputError if the size is not a whole number of points, there are too many, or a point's
/// time is none.
[[nodiscard]] DecodedScan decode_bin(std::span<const std::byte> bytes, std::string_view columns,
                                     const std::string& name, std::size_t max_points);

/// Columns that a file without any header looks like, where these cannot be x y z intensity: read
/// with a wrong number of columns, each of them holds a mixture of several, so that they differ
/// less than the right ones (Kolmogorov and Smirnov's distance).
/// @return "xyzir", "xyzit", "xyz" or such, with _ for what the numbers do not tell; nothing where
/// x y z intensity is as good, or there are fewer than 1,000 points.
[[nodiscard]] std::optional<std::string> other_bin_columns(std::span<const std::byte> bytes);

}  // namespace stillmap::maps
