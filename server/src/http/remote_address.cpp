#include "http/remote_address.hpp"

#include "http/header_text.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <charconv>

namespace stillmap::server {
namespace {

constexpr std::size_t kIpv4Prefix = 12;
constexpr int kIpv4PrefixBits = 96;
constexpr int kAllBits = 128;

/// "192.0.2.1", "192.0.2.1:8080", "2001:db8::1" or "[2001:db8::1]:8080", as proxies write it.
std::optional<IpAddress> address_with_port(std::string_view text) {
  if (text.starts_with('[')) return IpAddress::parse(text.substr(1, text.find(']') - 1));
  const std::size_t colon = text.find(':');
  const bool is_ipv4 = colon != std::string_view::npos && text.find(':', colon + 1) == text.npos;
  return IpAddress::parse(is_ipv4 ? text.substr(0, colon) : text);
}

/// Calls for each part between commas, without the blanks around it.
template <typename Use>
void for_each_part(std::string_view list, const Use& use) {
  for (std::size_t begin = 0; begin <= list.size();) {
    const std::size_t end = std::min(list.find(',', begin), list.size());
    use(trimmed(list.substr(begin, end - begin)));
    begin = end + 1;
  }
}

}  // namespace

std::optional<IpAddress> IpAddress::parse(std::string_view text) {
  // `inet_pton` takes text that ends with a zero.
  std::array<char, INET6_ADDRSTRLEN> copy{};
  if (text.size() >= copy.size() || text.find('\0') != std::string_view::npos) return std::nullopt;
  text.copy(copy.data(), text.size());
  std::array<unsigned char, 16> bytes{};
  if (::inet_pton(AF_INET, copy.data(), bytes.data()) == 1)
    return of_bytes(std::span(bytes).first(4));
  if (::inet_pton(AF_INET6, copy.data(), bytes.data()) == 1) return of_bytes(bytes);
  return std::nullopt;
}

std::optional<IpAddress> IpAddress::of_bytes(std::span<const unsigned char> bytes) {
  IpAddress address;
  if (bytes.size() == 4) {
    address.bytes_[10] = address.bytes_[11] = 0xff;
    std::copy(bytes.begin(), bytes.end(), address.bytes_.begin() + kIpv4Prefix);
    return address;
  }
  if (bytes.size() != address.bytes_.size()) return std::nullopt;
  std::copy(bytes.begin(), bytes.end(), address.bytes_.begin());
  return address;
}

std::string IpAddress::text() const {
  std::array<char, INET6_ADDRSTRLEN> text{};
  const bool ipv4 = is_ipv4();
  const char* const written =
      ::inet_ntop(ipv4 ? AF_INET : AF_INET6, bytes_.data() + (ipv4 ? kIpv4Prefix : 0), text.data(),
                  static_cast<socklen_t>(text.size()));
  return written == nullptr ? std::string{} : std::string(written);
}

bool IpAddress::is_ipv4() const {
  constexpr std::array<unsigned char, kIpv4Prefix> kMapped = {0, 0, 0, 0, 0,    0,
                                                              0, 0, 0, 0, 0xff, 0xff};
  return std::equal(kMapped.begin(), kMapped.end(), bytes_.begin());
}

bool IpAddress::is_loopback() const {
  if (is_ipv4()) return bytes_[kIpv4Prefix] == 127;
  return std::all_of(bytes_.begin(), bytes_.end() - 1, [](auto byte) { return byte == 0; }) &&
         bytes_.back() == 1;
}

bool IpAddress::begins_as(const IpAddress& other, int bits) const {
  const auto whole = static_cast<std::size_t>(bits / 8);
  if (!std::equal(bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(whole),
                  other.bytes_.begin()))
    return false;
  const int rest = bits % 8;
  if (rest == 0) return true;
  const int differ = bytes_.at(whole) ^ other.bytes_.at(whole);
  return (differ >> (8 - rest)) == 0;
}

std::string IpAddress::client_network() const {
  const auto count = is_ipv4() ? bytes_.size() : bytes_.size() / 2;
  return {bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(count)};
}

std::optional<IpAddress> peer_address(int socket) {
  sockaddr_storage peer{};
  socklen_t size = sizeof(peer);
  if (::getpeername(socket, reinterpret_cast<sockaddr*>(&peer), &size) != 0) return std::nullopt;
  const auto bytes_of = [](const auto& address) {
    return IpAddress::of_bytes(
        std::span(reinterpret_cast<const unsigned char*>(&address), sizeof(address)));
  };
  if (peer.ss_family == AF_INET)
    return bytes_of(reinterpret_cast<const sockaddr_in&>(peer).sin_addr);
  if (peer.ss_family == AF_INET6)
    return bytes_of(reinterpret_cast<const sockaddr_in6&>(peer).sin6_addr);
  return std::nullopt;
}

std::optional<TrustedProxies> TrustedProxies::parse(std::string_view list) {
  std::optional<TrustedProxies> result(std::in_place);
  if (trimmed(list).empty()) return result;
  for_each_part(list, [&](std::string_view part) {
    const std::size_t slash = part.find('/');
    const auto address = IpAddress::parse(part.substr(0, slash));
    if (!address || !result) return result.reset();
    int bits = kAllBits;
    if (slash != std::string_view::npos) {
      const std::string_view text = part.substr(slash + 1);
      const int most = address->is_ipv4() ? kAllBits - kIpv4PrefixBits : kAllBits;
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), bits);
      if (error != std::errc{} || end != text.data() + text.size() || bits < 0 || bits > most)
        return result.reset();
      if (address->is_ipv4()) bits += kIpv4PrefixBits;
    }
    result->networks_.push_back({*address, bits});
  });
  return result;
}

bool TrustedProxies::contain(const IpAddress& address) const {
  return std::any_of(networks_.begin(), networks_.end(), [&](const Network& network) {
    return address.begins_as(network.address, network.bits);
  });
}

IpAddress forwarded_address(const IpAddress& peer, const std::vector<std::string>& values,
                            const TrustedProxies& trusted) {
  std::vector<std::string_view> hops;
  for (const std::string& value : values)
    for_each_part(value, [&](std::string_view part) { hops.push_back(part); });
  IpAddress nearest = peer;
  for (auto hop = hops.rbegin(); hop != hops.rend() && trusted.contain(nearest); ++hop) {
    const std::optional<IpAddress> address = address_with_port(*hop);
    if (!address) break;
    nearest = *address;
  }
  return nearest;
}

}  // namespace stillmap::server
