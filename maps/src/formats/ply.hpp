#pragma once

#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/scan_file.hpp>

namespace stillmap::maps {

/// PLY 1.0. Elements other than `vertex`, and properties of it other than x y z, intensity and
/// time, are skipped, lists among them.
/// @throws InputError naming `name`, the value found and what was expected.
[[nodiscard]] DecodedScan decode_ply(std::span<const std::byte> bytes, const std::string& name,
                                     std::size_t max_points,
                                     std::optional<std::int64_t> stamp_ns = std::nullopt);

/// The same, handed on as it is read, in doubles. @throws as `decode_ply`, and what `take` throws.
CloudSummary stream_ply(std::span<const std::byte> bytes, const std::string& name,
                        const std::function<void(std::span<const CloudPoint>)>& take);

/// As `check_cloud_header`.
void check_ply_header(std::span<const std::byte> head, const std::string& name);

}  // namespace stillmap::maps
