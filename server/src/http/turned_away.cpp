#include "http/turned_away.hpp"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>

namespace stillmap::server {
namespace {

/// @return whether the client is done.
bool drained(int socket) {
  std::array<char, 4096> buffer;
  for (int pieces = 0; pieces < 64; ++pieces) {
    const ssize_t got = ::recv(socket, buffer.data(), buffer.size(), MSG_DONTWAIT);
    if (got == 0) return true;
    if (got < 0) return errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR;
  }
  return false;
}

}  // namespace

TurnedAway::~TurnedAway() {
  for (const Waiting& one : waiting_) ::close(one.socket);
}

void TurnedAway::add(int socket, const std::string& answer) {
  constexpr std::size_t kMost = 256;
  // It fits into the buffer of a new connection; if not, the client is told nothing.
  if (!answer.empty()) {
    static_cast<void>(::send(socket, answer.data(), answer.size(), MSG_NOSIGNAL | MSG_DONTWAIT));
  }
  if (answer.empty() || waiting_.size() >= kMost) {
    ::close(socket);
    return;
  }
  ::shutdown(socket, SHUT_WR);
  waiting_.push_back({socket, std::chrono::steady_clock::now() + std::chrono::seconds(1)});
}

void TurnedAway::watch(std::vector<pollfd>& entries) const {
  for (const Waiting& one : waiting_) {
    entries.push_back({.fd = one.socket, .events = POLLIN, .revents = 0});
  }
}

void TurnedAway::tend() {
  const auto now = std::chrono::steady_clock::now();
  std::erase_if(waiting_, [&](const Waiting& one) {
    if (now < one.until && !drained(one.socket)) return false;
    ::close(one.socket);
    return true;
  });
}

}  // namespace stillmap::server
