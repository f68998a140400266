#include "http/proxy_protocol.hpp"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {
namespace {

/// https://www.haproxy.org/download/2.8/doc/proxy-protocol.txt, section 2.2. The shortest header of
/// version 1 is longer.
constexpr std::string_view kProxySignature("\r\n\r\n\0\r\nQUIT\n", 12);
constexpr std::size_t kLongestVersion1 = 107;
constexpr std::size_t kLongestVersion2 = 4096;

using Read = std::function<bool(std::span<char>)>;

/// The part of a line up to the next blank, which is taken off it.
std::string_view next_word(std::string_view& line) {
  const std::size_t end = std::min(line.find(' '), line.size());
  const std::string_view word = line.substr(0, end);
  line.remove_prefix(std::min(end + 1, line.size()));
  return word;
}

/// "PROXY TCP4 192.0.2.1 192.0.2.2 5000 443\r\n", of which the beginning is read.
std::optional<ProxyHeader> read_version_1(std::string line, const Read& read) {
  while (!line.ends_with("\r\n")) {
    char c = 0;
    if (line.size() == kLongestVersion1 || !read(std::span(&c, 1))) return std::nullopt;
    line.push_back(c);
  }
  std::string_view rest = std::string_view(line).substr(0, line.size() - 2);
  if (next_word(rest) != "PROXY") return std::nullopt;
  const std::string_view family = next_word(rest);
  if (family == "UNKNOWN") return ProxyHeader{};
  const std::optional<IpAddress> source = IpAddress::parse(next_word(rest));
  if (!source || (family != "TCP4" && family != "TCP6")) return std::nullopt;
  return ProxyHeader{source};
}

std::optional<ProxyHeader> read_version_2(const Read& read) {
  constexpr unsigned kProxyCommand = 0x21;
  constexpr unsigned kLocalCommand = 0x20;
  constexpr unsigned kIpv4 = 1;
  constexpr unsigned kIpv6 = 2;
  std::array<char, 4> fixed{};
  if (!read(fixed)) return std::nullopt;
  const auto byte = [&fixed](std::size_t i) {
    return static_cast<unsigned>(static_cast<unsigned char>(fixed.at(i)));
  };
  const std::size_t length = byte(2) << 8U | byte(3);
  std::vector<char> block(std::min(length, kLongestVersion2));
  if (length > kLongestVersion2 || !read(block)) return std::nullopt;
  if (byte(0) == kLocalCommand) return ProxyHeader{};
  if (byte(0) != kProxyCommand) return std::nullopt;
  const unsigned family = byte(1) >> 4U;
  if (family != kIpv4 && family != kIpv6) return ProxyHeader{};
  // Both addresses and both ports.
  const std::size_t bytes = family == kIpv4 ? 4 : 16;
  if (block.size() < 2 * bytes + 4) return std::nullopt;
  return ProxyHeader{
      IpAddress::of_bytes(std::span(reinterpret_cast<const unsigned char*>(block.data()), bytes))};
}

}  // namespace

std::optional<ProxyHeader> read_proxy_header(const Read& read) {
  std::string begin(kProxySignature.size(), '\0');
  if (!read(begin)) return std::nullopt;
  if (begin == kProxySignature) return read_version_2(read);
  return begin.starts_with("PROXY ") ? read_version_1(std::move(begin), read) : std::nullopt;
}

std::optional<ProxyHeader> read_proxy_header(int socket, std::chrono::milliseconds most) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point until = Clock::now() + most;
  return read_proxy_header([&](std::span<char> to) {
    while (!to.empty()) {
      const ssize_t got = ::recv(socket, to.data(), to.size(), MSG_DONTWAIT);
      if (got > 0) {
        to = to.subspan(static_cast<std::size_t>(got));
        continue;
      }
      if (got == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) return false;
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now()).count();
      pollfd entry{.fd = socket, .events = POLLIN, .revents = 0};
      if (left <= 0 || ::poll(&entry, 1, static_cast<int>(left)) == 0) return false;
    }
    return true;
  });
}

}  // namespace stillmap::server
