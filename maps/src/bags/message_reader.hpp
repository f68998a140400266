#pragma once

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>

#include "bags/bag.hpp"

namespace stillmap::maps {

/// Reads the values of one ROS message in their order: CDR as ROS 2 writes it (XCDR1 plain, 4 bytes
/// of encapsulation that tell the byte order, alignment counted behind them; OMG DDS-XTypes 1.3,
/// 7.4.1), or ROS 1 (little endian, packed). Every length is checked against the bytes at hand.
class MessageReader {
 public:
  /// @param message  outlives this. @param name  for messages of errors.
  /// @throws InputError for another serialization or encapsulation.
  MessageReader(std::span<const std::byte> message, Serialization serialization, std::string name);

  template <typename Number>
  Number number() {
    align(sizeof(Number));
    std::array<std::byte, sizeof(Number)> raw;
    std::memcpy(raw.data(), take(sizeof(Number)).data(), sizeof(Number));
    if (big_endian_) std::reverse(raw.begin(), raw.end());
    Number value;
    std::memcpy(&value, raw.data(), sizeof(Number));
    return value;
  }
  bool flag() { return number<std::uint8_t>() != 0; }
  /// Length and letters; CDR counts the NUL behind them. @param most  letters.
  std::string text(std::size_t most = 1024);
  /// A sequence of bytes.
  std::span<const std::byte> bytes();
  /// An array of so many bytes, without a length.
  std::span<const std::byte> array(std::size_t size) { return take(size); }
  /// Length of a sequence whose elements take at least so many bytes each.
  std::size_t count(std::size_t least_bytes_each);
  [[nodiscard]] bool is_ros1() const { return ros1_; }
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  void align(std::size_t size);
  std::span<const std::byte> take(std::size_t size);

  std::span<const std::byte> body_;
  std::size_t position_ = 0;
  bool big_endian_ = false;
  bool ros1_ = false;
  std::string name_;
};

}  // namespace stillmap::maps
