#include "operation/health_probe.hpp"

#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <memory>
#include <string_view>

namespace stillmap::server {
namespace {

using Clock = std::chrono::steady_clock;

class Socket {
 public:
  explicit Socket(int handle) : handle_(handle) {}
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  ~Socket() {
    if (handle_ >= 0) ::close(handle_);
  }
  [[nodiscard]] int handle() const { return handle_; }

 private:
  int handle_;
};

bool wait_for(int handle, short events, Clock::time_point until) {
  const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now());
  pollfd poll{.fd = handle, .events = events, .revents = 0};
  return ::poll(&poll, 1, static_cast<int>(std::max<std::int64_t>(0, left.count()))) == 1;
}

bool connect_to(int handle, const addrinfo& address, Clock::time_point until) {
  if (::connect(handle, address.ai_addr, address.ai_addrlen) == 0) return true;
  if (errno != EINPROGRESS || !wait_for(handle, POLLOUT, until)) return false;
  int error = 0;
  socklen_t size = sizeof error;
  return ::getsockopt(handle, SOL_SOCKET, SO_ERROR, &error, &size) == 0 && error == 0;
}

std::string reachable(const std::string& host) {
  if (host == "0.0.0.0") return "127.0.0.1";
  if (host == "::") return "::1";
  return host;
}

/// The first bytes of an answer; fewer when it ends or time is up.
std::string read_start(int handle, std::size_t size, Clock::time_point until) {
  std::string text;
  std::array<char, 64> buffer{};
  while (text.size() < size && wait_for(handle, POLLIN, until)) {
    const ssize_t got = ::recv(handle, buffer.data(), buffer.size(), 0);
    if (got <= 0) break;
    text.append(buffer.data(), static_cast<std::size_t>(got));
  }
  return text;
}

bool ask(const addrinfo& address, Clock::time_point until) {
  const Socket socket(::socket(address.ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (socket.handle() < 0 || !connect_to(socket.handle(), address, until)) return false;
  constexpr std::string_view kRequest =
      "GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
  // Small enough for the socket's buffer, which is empty.
  if (::send(socket.handle(), kRequest.data(), kRequest.size(), MSG_NOSIGNAL) !=
      static_cast<ssize_t>(kRequest.size()))
    return false;
  constexpr std::string_view kGood = "HTTP/1.1 200 ";
  return read_start(socket.handle(), kGood.size(), until).starts_with(kGood);
}

}  // namespace

bool answers_livez(const std::string& host, int port, std::chrono::milliseconds timeout) {
  const Clock::time_point until = Clock::now() + timeout;
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (::getaddrinfo(reachable(host).c_str(), std::to_string(port).c_str(), &hints, &found) != 0)
    return false;
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner(found, ::freeaddrinfo);
  for (const addrinfo* each = found; each != nullptr; each = each->ai_next) {
    if (ask(*each, until)) return true;
  }
  return false;
}

}  // namespace stillmap::server
