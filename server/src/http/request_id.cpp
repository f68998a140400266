#include "http/request_id.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <random>

namespace stillmap::server {
namespace {

std::uint64_t random_start() {
  std::random_device device;
  return (std::uint64_t{device()} << 32U) | device();
}

}  // namespace

std::string new_request_id() {
  // Counting up from a random start.
  static std::atomic<std::uint64_t> next{random_start()};
  return fmt::format("{:016x}", next.fetch_add(1));
}

std::string request_id_from(std::string_view client_id, const std::string& own) {
  constexpr std::string_view kAllowed =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";
  const bool usable = !client_id.empty() && client_id.size() <= 64 &&
                      client_id.find_first_not_of(kAllowed) == std::string_view::npos;
  return usable ? std::string(client_id) : own;
}

std::string printable(std::string_view text) {
  std::string result(text);
  std::replace_if(
      result.begin(), result.end(),
      [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }, '?');
  return result;
}

}  // namespace stillmap::server
