#include "bags/udp_packet.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

namespace stillmap::maps::pcap {
namespace {

/// Names of https://www.tcpdump.org/linktypes.html. The second and third raw IP are what some
/// systems write for the first.
enum Link : std::uint32_t {
  kEthernet = 1,
  kRawIp12 = 12,
  kRawIp14 = 14,
  kRawIp = 101,
  kLinuxSll = 113,
  kIpv4 = 228,
  kLinuxSll2 = 276
};
constexpr std::uint16_t kEtherIpv4 = 0x0800;

std::uint16_t network_u16(std::span<const std::byte> bytes, std::size_t at) {
  return integer_at<std::uint16_t>(bytes, at, true);
}

bool is_vlan(std::uint16_t type) { return type == 0x8100 || type == 0x88a8 || type == 0x9100; }

/// Bytes behind a header. @param type_at  where the header says what follows.
/// @return nothing where that is not IPv4.
std::optional<std::span<const std::byte>> behind(std::span<const std::byte> bytes,
                                                 std::size_t header, std::size_t type_at) {
  if (bytes.size() < header) return std::nullopt;
  std::uint16_t type = network_u16(bytes, type_at);
  std::span<const std::byte> rest = bytes.subspan(header);
  while (is_vlan(type) && rest.size() >= 4) {
    type = network_u16(rest, 2);
    rest = rest.subspan(4);
  }
  if (type != kEtherIpv4) return std::nullopt;
  return rest;
}

UdpPacket read_ipv4(std::span<const std::byte> bytes) {
  constexpr std::size_t kUdpHeader = 8;
  constexpr unsigned kUdp = 17;
  UdpPacket packet;
  if (bytes.size() < 20) return packet;
  const auto first = std::to_integer<unsigned>(bytes[0]);
  const std::size_t header = std::size_t{4} * (first & 0xfU);
  const std::size_t total = network_u16(bytes, 2);
  if (first >> 4U != 4 || header < 20 || std::to_integer<unsigned>(bytes[9]) != kUdp) return packet;
  // All but "don't fragment": more parts follow, or this one has a place behind others.
  if ((network_u16(bytes, 6) & 0x3fffU) != 0) {
    packet.kind = UdpPacket::Kind::kFragment;
    return packet;
  }
  if (total < header + kUdpHeader) return packet;
  packet.source = integer_at<std::uint32_t>(bytes, 12, true);
  if (bytes.size() < total) {
    packet.kind = UdpPacket::Kind::kCut;
    return packet;
  }
  // Short packets are filled up on Ethernet.
  const std::span<const std::byte> udp = bytes.first(total).subspan(header);
  const std::size_t size = network_u16(udp, 4);
  if (size < kUdpHeader || size > udp.size()) return packet;
  packet.kind = UdpPacket::Kind::kWhole;
  packet.port = network_u16(udp, 2);
  packet.payload = udp.first(size).subspan(kUdpHeader);
  return packet;
}

}  // namespace

UdpPacket read_udp(const CapturedPacket& packet) {
  std::optional<std::span<const std::byte>> ip;
  switch (packet.link) {
    case kEthernet:
      ip = behind(packet.bytes, 14, 12);
      break;
    case kLinuxSll:
      ip = behind(packet.bytes, 16, 14);
      break;
    case kLinuxSll2:
      ip = behind(packet.bytes, 20, 0);
      break;
    case kRawIp:
    case kRawIp12:
    case kRawIp14:
    case kIpv4:
      ip = packet.bytes;
      break;
    default:
      return {UdpPacket::Kind::kUnknownLink, 0, 0, {}};
  }
  return ip ? read_ipv4(*ip) : UdpPacket{};
}

std::string address_text(std::uint32_t source, std::uint16_t port) {
  return fmt::format("{}.{}.{}.{}:{}", source >> 24U, source >> 16U & 0xffU, source >> 8U & 0xffU,
                     source & 0xffU, port);
}

}  // namespace stillmap::maps::pcap
