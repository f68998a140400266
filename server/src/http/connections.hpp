#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace stillmap::server {

/// Which connections are open and what each is at, so that they can be ended from outside. Safe
/// from several threads.
class Connections {
 public:
  enum class State : std::uint8_t {
    kIdle,       ///< between requests
    kReceiving,  ///< a head, or a body that is held as a whole
    kAnswering,
    kStalled,  ///< in an answer that the client does not take
  };

  void add(int socket);
  /// Counts the connection to a client. @param client  as `IpAddress::client_network`.
  /// @return false, and does not count it, when the client has `most` already.
  [[nodiscard]] bool claim(int socket, const std::string& client, std::size_t most);
  /// Call before the socket is closed.
  void remove(int socket);
  void set(int socket, State state);

  /// Those in this state read an end of the connection instead of waiting.
  void interrupt(State state);
  /// Ends the one that has been idle or stalled for longest, if any. @param socket  has just come
  /// and stays.
  void make_room(int socket);
  /// Whether it was ended without waiting for what it is at.
  [[nodiscard]] bool is_cut(int socket) const;
  /// Ends all, also what is being sent.
  void cut();
  [[nodiscard]] std::size_t count() const;

 private:
  struct Entry {
    State state = State::kIdle;
    std::chrono::steady_clock::time_point since;
    bool interrupted = false;
    bool cut = false;
    /// Empty where it is not counted.
    std::string client{};
  };

  mutable std::mutex mutex_;
  std::map<int, Entry> entries_;
  /// Connections of each client that has any.
  std::map<std::string, std::size_t> of_clients_;
};

}  // namespace stillmap::server
