#pragma once

#include <chrono>
#include <string>

namespace stillmap::server {

/// Asks a server of this machine for `/livez` as a client would, over plain HTTP.
/// @param host  what it listens on; an address that stands for all is asked by loopback.
/// @return whether 200 came in time; false on every trouble.
[[nodiscard]] bool answers_livez(const std::string& host, int port,
                                 std::chrono::milliseconds timeout);

}  // namespace stillmap::server
