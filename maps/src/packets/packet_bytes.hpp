#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace stillmap::maps {

/// A whole number of a packet or of a file of packets. @param bytes  has it.
template <typename Integer>
[[nodiscard]] Integer integer_at(std::span<const std::byte> bytes, std::size_t at,
                                 bool big_endian = false) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < sizeof(Integer); ++i) {
    const std::size_t place = big_endian ? i : sizeof(Integer) - 1 - i;
    value = value << 8U | std::to_integer<std::uint64_t>(bytes[at + place]);
  }
  return static_cast<Integer>(value);
}

}  // namespace stillmap::maps
