#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace stillmap::maps {

/// CRC-32C (Castagnoli) of bytes, as in iSCSI (RFC 3720) and ext4; finds what a disk or a cut copy
/// does to a file, not what somebody does on purpose.
/// @param before  the result for the bytes in front of these, 0 at the beginning.
[[nodiscard]] std::uint32_t crc32c(std::span<const std::byte> bytes, std::uint32_t before = 0);

}  // namespace stillmap::maps
