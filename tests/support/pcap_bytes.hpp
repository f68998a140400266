#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

/// Captures of packets, written out by hand so that tests do not depend on a writer of ours.
namespace stillmap::test {

/// A number in network order, or the other one.
template <typename Number>
[[nodiscard]] std::string number_bytes(Number number, bool big_endian = true) {
  std::string raw(sizeof(Number), '\0');
  std::memcpy(raw.data(), &number, sizeof(Number));
  if (big_endian) std::reverse(raw.begin(), raw.end());
  return raw;
}

/// @param fragment  flags and place of a part of a packet.
[[nodiscard]] inline std::string udp_over_ipv4(std::string_view payload, std::uint32_t source,
                                               std::uint16_t port, std::uint16_t fragment = 0) {
  const auto size = static_cast<std::uint16_t>(payload.size());
  const auto u16 = [](int value) { return number_bytes(static_cast<std::uint16_t>(value)); };
  return "\x45" + std::string(1, '\0') + u16(size + 28) + u16(7) + u16(fragment) + "\x40\x11" +
         u16(0) + number_bytes(source) + number_bytes(std::uint32_t{0xffffffff}) + u16(2368) +
         u16(port) + u16(size + 8) + u16(0) + std::string(payload);
}

/// What stands before IPv4, by LINKTYPE_.
[[nodiscard]] inline std::string link_header(std::uint32_t link, bool with_vlan = false) {
  using namespace std::string_literals;
  const std::string type = with_vlan ? "\x81\x00\x00\x05\x08\x00"s : "\x08\x00"s;
  if (link == 1) return std::string(12, '\x11') + type;
  if (link == 113) return std::string(14, '\0') + type;
  if (link == 276) return "\x08\x00"s + std::string(18, '\0');
  return "";
}

/// A data packet of a VLP-16, whose blocks stand 0.2 deg apart and see a wall at some range.
[[nodiscard]] inline std::string vlp16_packet(unsigned azimuth, std::uint16_t range = 5000) {
  std::string packet;
  for (unsigned block = 0; block < 12; ++block) {
    packet += "\xff\xee";
    packet += number_bytes(static_cast<std::uint16_t>((azimuth + 20 * block) % 36'000), false);
    for (int i = 0; i < 32; ++i) packet += number_bytes(range, false) + "\x07";
  }
  return packet + std::string(4, '\0') + "\x37\x22";
}

class PcapBytes {
 public:
  explicit PcapBytes(std::uint32_t link = 1, bool big_endian = false, bool nanoseconds = false)
      : big_(big_endian), nanoseconds_(nanoseconds) {
    bytes_ = u32(nanoseconds ? 0xa1b23c4d : 0xa1b2c3d4) + number_bytes(std::uint16_t{2}, big_) +
             number_bytes(std::uint16_t{4}, big_) + u32(0) + u32(0) + u32(262'144) + u32(link);
  }
  /// @param whole_size  of a packet of which the capture kept less; 0 = all.
  void add(std::int64_t stamp_ns, std::string_view packet, std::uint32_t whole_size = 0) {
    const std::int64_t part = stamp_ns % 1'000'000'000;
    const auto size = static_cast<std::uint32_t>(packet.size());
    bytes_ += u32(static_cast<std::uint32_t>(stamp_ns / 1'000'000'000)) +
              u32(static_cast<std::uint32_t>(nanoseconds_ ? part : part / 1000)) + u32(size) +
              u32(std::max(size, whole_size)) + std::string(packet);
  }
  [[nodiscard]] const std::string& str() const { return bytes_; }

 private:
  [[nodiscard]] std::string u32(std::uint32_t value) const { return number_bytes(value, big_); }

  bool big_;
  bool nanoseconds_;
  std::string bytes_;
};

/// Sections of pcapng.
class PcapngBytes {
 public:
  explicit PcapngBytes(bool big_endian = false) { section(big_endian); }
  void section(bool big_endian) {
    big_ = big_endian;
    block(0x0a0d0d0a, u32(0x1a2b3c4d) + number_bytes(std::uint16_t{1}, big_) +
                          number_bytes(std::uint16_t{0}, big_) + std::string(8, '\xff'));
  }
  /// @param options  each with code, length and value, filled up to 4 bytes.
  void interface(std::uint16_t link, std::string_view options = "") {
    block(1, number_bytes(link, big_) + std::string(2, '\0') + u32(0) + std::string(options));
  }
  [[nodiscard]] std::string option(std::uint16_t code, std::string_view value) const {
    return number_bytes(code, big_) + number_bytes(static_cast<std::uint16_t>(value.size()), big_) +
           filled(value);
  }
  void add(std::uint64_t ticks, std::string_view packet, std::uint32_t number = 0) {
    const auto size = static_cast<std::uint32_t>(packet.size());
    block(6, u32(number) + u32(static_cast<std::uint32_t>(ticks >> 32U)) +
                 u32(static_cast<std::uint32_t>(ticks)) + u32(size) + u32(size) + filled(packet));
  }
  void block(std::uint32_t type, std::string_view body) {
    const auto size = static_cast<std::uint32_t>(body.size() + 12);
    bytes_ += u32(type) + u32(size) + std::string(body) + u32(size);
  }
  [[nodiscard]] bool is_big_endian() const { return big_; }
  [[nodiscard]] const std::string& str() const { return bytes_; }

 private:
  [[nodiscard]] std::string u32(std::uint32_t value) const { return number_bytes(value, big_); }
  static std::string filled(std::string_view value) {
    return std::string(value) + std::string((4 - value.size() % 4) % 4, '\0');
  }

  bool big_ = false;
  std::string bytes_;
};

}  // namespace stillmap::test
