#pragma once

#include <string>

namespace stillmap::server {

/// @return the address of whoever is connected, as text without the port: IPv4 also where it
/// arrived on an IPv6 socket. Empty for a socket without one.
[[nodiscard]] std::string peer_address(int socket);

}  // namespace stillmap::server
