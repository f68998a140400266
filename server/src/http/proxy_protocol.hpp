#pragma once

#include "http/remote_address.hpp"

#include <chrono>
#include <cstddef>
#include <functional>
#include <optional>
#include <span>

namespace stillmap::server {

/// What a proxy says of a connection, in the PROXY protocol of HAProxy, before any byte of it.
struct ProxyHeader {
  /// Nothing for a connection of the proxy's own, such as a health check.
  std::optional<IpAddress> source{};
};

/// Reads a header of version 1 or 2, and not a byte more.
/// @param read  fills all of its argument; returns false when it cannot.
/// @return nothing when there is no such header, it is cut off or longer than 4 KiB.
[[nodiscard]] std::optional<ProxyHeader> read_proxy_header(
    const std::function<bool(std::span<char>)>& read);
/// The same of a non-blocking socket. @param most  how long it may take.
[[nodiscard]] std::optional<ProxyHeader> read_proxy_header(int socket,
                                                           std::chrono::milliseconds most);

}  // namespace stillmap::server
