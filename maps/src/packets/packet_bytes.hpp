#pragma once

#include <bit>
#include <cstddef>
#include <cstring>
#include <span>

namespace stillmap::maps {

/// A little-endian number of a packet. @param at  with the number's bytes inside `packet`.
template <typename Number>
[[nodiscard]] Number packet_number(std::span<const std::byte> packet, std::size_t at) {
  static_assert(std::endian::native == std::endian::little);
  Number value{};
  std::memcpy(&value, packet.subspan(at, sizeof(Number)).data(), sizeof(Number));
  return value;
}

}  // namespace stillmap::maps
