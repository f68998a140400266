#include "http/listening_socket.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <stdexcept>

namespace stillmap::server {
namespace {

int listen_at(const addrinfo& address) {
  const int socket = ::socket(address.ai_family, address.ai_socktype | SOCK_CLOEXEC | SOCK_NONBLOCK,
                              address.ai_protocol);
  if (socket < 0) return -1;
  // A port that the server had a moment ago can be had again; a port that another process has
  // cannot, which SO_REUSEPORT would allow.
  const int yes = 1;
  ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
  if (::bind(socket, address.ai_addr, address.ai_addrlen) == 0 &&
      ::listen(socket, SOMAXCONN) == 0) {
    return socket;
  }
  const int why = errno;
  ::close(socket);
  errno = why;
  return -1;
}

int port_of(int socket) {
  sockaddr_storage address{};
  socklen_t size = sizeof(address);
  if (::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) != 0) return 0;
  if (address.ss_family == AF_INET6)
    return ntohs(reinterpret_cast<const sockaddr_in6*>(&address)->sin6_port);
  return ntohs(reinterpret_cast<const sockaddr_in*>(&address)->sin_port);
}

}  // namespace

ListeningSocket::ListeningSocket(const std::string& host, int port) {
  addrinfo wish{};
  wish.ai_socktype = SOCK_STREAM;
  wish.ai_flags = AI_PASSIVE;
  addrinfo* list = nullptr;
  errno = 0;
  if (::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &wish, &list) == 0) {
    const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owner(list, ::freeaddrinfo);
    for (const addrinfo* at = list; at != nullptr && socket_ < 0; at = at->ai_next) {
      socket_ = listen_at(*at);
    }
  }
  if (socket_ < 0) {
    throw std::runtime_error(
        fmt::format("{}:{}: found it taken or not ours ({}), expected a free address", host, port,
                    errno == 0 ? "no such host" : std::strerror(errno)));
  }
  port_ = port_of(socket_);
}

int ListeningSocket::accept(std::chrono::milliseconds unacknowledged) const {
  const int connection = ::accept4(socket_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (connection < 0) return -1;
  // An answer is two writes, and the second would wait for the first one's acknowledgement.
  const int yes = 1;
  ::setsockopt(connection, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof(yes));
  // By default the kernel goes on trying for a quarter of an hour. SO_KEEPALIVE would add nothing:
  // whatever waits for bytes has its own time, and event streams are never silent for long.
  // A client that takes nothing holds so much of the kernel's memory. Bytes that are on their way
  // to a client that does take them are not bounded by this, so downloads over long links stay
  // fast.
  const int most_unsent_bytes = 64 << 10;
  ::setsockopt(connection, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &most_unsent_bytes,
               sizeof(most_unsent_bytes));
  const auto most_ms = static_cast<unsigned>(unacknowledged.count());
  ::setsockopt(connection, IPPROTO_TCP, TCP_USER_TIMEOUT, &most_ms, sizeof(most_ms));
  return connection;
}

void ListeningSocket::close() {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

}  // namespace stillmap::server
