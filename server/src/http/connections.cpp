#include "http/connections.hpp"

#include <sys/socket.h>

namespace stillmap::server {

void Connections::add(int socket) {
  const std::lock_guard lock(mutex_);
  entries_[socket] = {.since = std::chrono::steady_clock::now()};
}

void Connections::remove(int socket) {
  const std::lock_guard lock(mutex_);
  entries_.erase(socket);
}

void Connections::set(int socket, State state) {
  const std::lock_guard lock(mutex_);
  Entry& entry = entries_[socket];
  entry.state = state;
  entry.since = std::chrono::steady_clock::now();
}

void Connections::interrupt(State state) {
  const std::lock_guard lock(mutex_);
  // What has already arrived can still be read.
  for (const auto& [socket, entry] : entries_) {
    if (entry.state == state) ::shutdown(socket, SHUT_RD);
  }
}

void Connections::interrupt_longest_idle() {
  const std::lock_guard lock(mutex_);
  auto longest = entries_.end();
  for (auto entry = entries_.begin(); entry != entries_.end(); ++entry) {
    if (entry->second.state != State::kIdle || entry->second.interrupted) continue;
    if (longest == entries_.end() || entry->second.since < longest->second.since) longest = entry;
  }
  if (longest == entries_.end()) return;
  longest->second.interrupted = true;
  ::shutdown(longest->first, SHUT_RD);
}

void Connections::cut() {
  const std::lock_guard lock(mutex_);
  for (const auto& [socket, entry] : entries_) ::shutdown(socket, SHUT_RDWR);
}

std::size_t Connections::count() const {
  const std::lock_guard lock(mutex_);
  return entries_.size();
}

}  // namespace stillmap::server
