#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "bags/pcap_records.hpp"

namespace stillmap::maps::pcap {

/// What a captured packet holds of a sensor's data.
struct UdpPacket {
  enum class Kind : std::uint8_t {
    /// UDP over IPv4, with all its bytes.
    kWhole,
    /// The same, of which the capture kept only the first bytes.
    kCut,
    /// A part of a packet that was sent in several.
    kFragment,
    /// Captured with a header that is not known here.
    kUnknownLink,
    kOther
  };
  Kind kind = Kind::kOther;
  /// Who sent it, and the port that it was sent to.
  std::uint32_t source = 0;
  std::uint16_t port = 0;
  std::span<const std::byte> payload;
};

/// Looks through Ethernet (with VLAN tags), Linux' cooked headers (SLL, SLL2) and raw IP.
/// @return spans of the packet's bytes.
[[nodiscard]] UdpPacket read_udp(const CapturedPacket& packet);

/// "192.168.1.201:2368". @param source  an IPv4 address.
[[nodiscard]] std::string address_text(std::uint32_t source, std::uint16_t port);

}  // namespace stillmap::maps::pcap
