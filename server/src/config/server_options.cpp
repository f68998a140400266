#include <stillmap/server/server_options.hpp>

#include "config/option_table.hpp"

#include <fmt/format.h>

namespace stillmap::server {

std::vector<std::string> ServerOptions::violations() const {
  std::vector<std::string> result;
  for (const BrokenOption& broken : broken_options(*this)) {
    result.push_back(fmt::format("{}: {}, {}", broken.key, broken.found, broken.expected));
  }
  return result;
}

bool is_loopback(const std::string& host) {
  // Only digits and dots after "127.", so that "127.example.org" is no loopback.
  const bool dotted =
      host.starts_with("127.") && host.find_first_not_of("0123456789.") == std::string::npos;
  return dotted || host == "::1" || host == "localhost";
}

}  // namespace stillmap::server
