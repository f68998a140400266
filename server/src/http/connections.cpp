#include "http/connections.hpp"

#include <sys/socket.h>

namespace stillmap::server {

void Connections::add(int socket) {
  const std::lock_guard lock(mutex_);
  entries_[socket] = {.since = std::chrono::steady_clock::now()};
}

bool Connections::claim(int socket, const std::string& client, std::size_t most) {
  const std::lock_guard lock(mutex_);
  const auto count = of_clients_.try_emplace(client, 0).first;
  if (count->second >= most) return false;
  ++count->second;
  entries_[socket].client = client;
  return true;
}

void Connections::remove(int socket) {
  const std::lock_guard lock(mutex_);
  const auto entry = entries_.find(socket);
  if (entry == entries_.end()) return;
  if (const auto count = of_clients_.find(entry->second.client);
      count != of_clients_.end() && --count->second == 0)
    of_clients_.erase(count);
  entries_.erase(entry);
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

void Connections::make_room(int socket) {
  // A client far away, or on a poor link, takes nothing for a moment.
  constexpr std::chrono::milliseconds kMoment(500);
  const std::lock_guard lock(mutex_);
  const auto now = std::chrono::steady_clock::now();
  auto longest = entries_.end();
  for (auto entry = entries_.begin(); entry != entries_.end(); ++entry) {
    const Entry& each = entry->second;
    const bool is_stalled = each.state == State::kStalled && now - each.since > kMoment;
    if (entry->first == socket || each.interrupted || !(each.state == State::kIdle || is_stalled))
      continue;
    if (longest == entries_.end() || each.since < longest->second.since) longest = entry;
  }
  if (longest == entries_.end()) return;
  longest->second.interrupted = true;
  longest->second.cut = longest->second.state == State::kStalled;
  // An idle one may have been sent a request meanwhile, which can still be read.
  ::shutdown(longest->first, longest->second.state == State::kIdle ? SHUT_RD : SHUT_RDWR);
}

void Connections::cut() {
  const std::lock_guard lock(mutex_);
  for (auto& [socket, entry] : entries_) {
    entry.cut = true;
    ::shutdown(socket, SHUT_RDWR);
  }
}

bool Connections::is_cut(int socket) const {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(socket);
  return found != entries_.end() && found->second.cut;
}

std::size_t Connections::count() const {
  const std::lock_guard lock(mutex_);
  return entries_.size();
}

}  // namespace stillmap::server
