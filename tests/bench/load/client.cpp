#include "client.hpp"

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstdint>
#include <utility>

namespace stillmap::bench {
namespace {

constexpr int kPatienceMs = 20'000;

bool ready(int socket, short events, int timeout_ms) {
  pollfd entry{.fd = socket, .events = events, .revents = 0};
  return ::poll(&entry, 1, timeout_ms) > 0 && (entry.revents & (events | POLLHUP)) != 0;
}

std::string_view header(std::string_view head, std::string_view name) {
  const std::size_t at = head.find(name);
  if (at == std::string_view::npos) return {};
  const std::string_view rest = head.substr(at + name.size());
  return rest.substr(0, rest.find('\r'));
}

}  // namespace

bool Client::connect() {
  buffer_.clear();
  socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port_));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    close();
    return false;
  }
  const int on = 1;
  ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  return true;
}

void Client::close() {
  if (socket_ >= 0) ::close(std::exchange(socket_, -1));
}

bool Client::send(std::string_view bytes, bool stop_when_answered) {
  while (!bytes.empty()) {
    if (stop_when_answered && ready(socket_, POLLIN, 0)) return true;
    const ssize_t sent =
        ::send(socket_, bytes.data(), std::min<std::size_t>(bytes.size(), 1U << 18U),
               MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0 && errno != EAGAIN && errno != EINTR) return false;
    if (sent > 0) {
      bytes.remove_prefix(static_cast<std::size_t>(sent));
    } else if (!ready(socket_, stop_when_answered ? POLLOUT | POLLIN : POLLOUT, kPatienceMs)) {
      return false;
    }
  }
  return true;
}

Client::Answer Client::receive() {
  std::array<char, 16384> piece{};
  std::size_t head_end = std::string::npos;
  std::size_t length = 0;
  while (head_end == std::string::npos || buffer_.size() < head_end + 4 + length) {
    if (!ready(socket_, POLLIN, kPatienceMs)) return {};
    const ssize_t got = ::recv(socket_, piece.data(), piece.size(), 0);
    if (got <= 0) return {};
    buffer_.append(piece.data(), static_cast<std::size_t>(got));
    if (head_end != std::string::npos) continue;
    head_end = buffer_.find("\r\n\r\n");
    if (head_end == std::string::npos) continue;
    const std::string_view text =
        header(std::string_view(buffer_).substr(0, head_end + 2), "Content-Length: ");
    std::from_chars(text.data(), text.data() + text.size(), length);
  }
  Answer answer;
  const std::string_view head = std::string_view(buffer_).substr(0, head_end + 2);
  std::from_chars(head.data() + 9, head.data() + 12, answer.status);
  const bool last = header(head, "Connection: ") == "close";
  answer.body = buffer_.substr(head_end + 4, length);
  buffer_.erase(0, head_end + 4 + length);
  if (last) close();
  return answer;
}

Client::Answer Client::request(std::string_view method, std::string_view target,
                               std::string_view body) {
  std::string head(method);
  head.append(" ").append(target).append(" HTTP/1.1\r\nHost: localhost\r\n");
  if (method == "POST") {
    head += "Content-Type: " + content_type_ +
            "\r\nContent-Length: " + std::to_string(body.size()) + "\r\n";
  }
  head += "\r\n";
  // An idle connection may have been closed meanwhile: once more on a fresh one.
  for (int attempt = 0; attempt < 2; ++attempt) {
    const bool fresh = socket_ < 0;
    if (fresh && !connect()) return {};
    if (send(head, false) && send(body, true)) {
      if (Answer answer = receive(); answer.status != 0) return answer;
    }
    close();
    if (fresh) return {};
  }
  return {};
}

}  // namespace stillmap::bench
