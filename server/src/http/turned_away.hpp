#pragma once

#include <chrono>
#include <string>
#include <vector>

struct pollfd;

namespace stillmap::server {

/// Connections that got an answer without being read: each stays open until its client has seen
/// the answer, since closing at once would reset it. One thread, never blocks.
class TurnedAway {
 public:
  TurnedAway() = default;
  ~TurnedAway();
  TurnedAway(const TurnedAway&) = delete;
  TurnedAway& operator=(const TurnedAway&) = delete;

  /// Answers and keeps the socket for a second; beyond 256 of them it is closed at once.
  /// @param answer  complete bytes of an HTTP answer; empty = none is sent, as under TLS.
  void add(int socket, const std::string& answer);
  /// Adds what to wait for.
  void watch(std::vector<pollfd>& entries) const;
  /// Takes what clients still send, and closes those that are done.
  void tend();
  [[nodiscard]] bool empty() const { return waiting_.empty(); }

 private:
  struct Waiting {
    int socket;
    std::chrono::steady_clock::time_point until;
  };
  std::vector<Waiting> waiting_;
};

}  // namespace stillmap::server
