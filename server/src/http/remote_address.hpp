#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// An IPv4 or IPv6 address. IPv4 that arrives on an IPv6 socket is IPv4.
class IpAddress {
 public:
  /// @return nothing when the text is no address. @param text  without a port.
  static std::optional<IpAddress> parse(std::string_view text);
  /// @param bytes  4 or 16, in network order.
  static std::optional<IpAddress> of_bytes(std::span<const unsigned char> bytes);

  [[nodiscard]] std::string text() const;
  [[nodiscard]] bool is_ipv4() const;
  [[nodiscard]] bool is_loopback() const;
  /// Whether the first `bits` are the same. @param bits  0 to 128; of IPv4 those behind the 96.
  [[nodiscard]] bool begins_as(const IpAddress& other, int bits) const;
  /// What one client has: an IPv4 address, or the first 64 bits of IPv6.
  [[nodiscard]] std::string client_network() const;

 private:
  /// IPv4 as ::ffff:a.b.c.d.
  std::array<unsigned char, 16> bytes_{};
};

/// @return the address of whoever is connected; nothing for a socket without one.
[[nodiscard]] std::optional<IpAddress> peer_address(int socket);

/// Addresses and networks of the proxies whose word on a client's address is believed.
class TrustedProxies {
 public:
  TrustedProxies() = default;
  /// @param list  such as "127.0.0.1, 10.0.0.0/8, 2001:db8::/32"; may be empty.
  /// @return nothing when a part of it is no address and no network.
  static std::optional<TrustedProxies> parse(std::string_view list);
  [[nodiscard]] bool contain(const IpAddress& address) const;

 private:
  struct Network {
    IpAddress address;
    int bits = 0;
  };
  std::vector<Network> networks_;
};

/// @return the client's address by `X-Forwarded-For`: the rightmost that is no trusted proxy. What
/// stands left of that is the client's own claim. Where a proxy has written something else than an
/// address, that proxy's own address.
/// @param peer  whoever is connected. @param values  of the header, each a list, in their order.
[[nodiscard]] IpAddress forwarded_address(const IpAddress& peer,
                                          const std::vector<std::string>& values,
                                          const TrustedProxies& trusted);

}  // namespace stillmap::server
