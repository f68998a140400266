#pragma once

#include "http/http_message.hpp"

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::server {

/// What happened in a session, the newest few, for streams that come and go. Safe from several
/// threads.
class SessionEvents {
 public:
  /// Older ones are forgotten; a stream that comes back later is told that it missed some.
  static constexpr std::size_t kKept = 256;

  struct Event {
    /// Counts from 1.
    std::uint64_t id = 0;
    std::string type;
    /// JSON on one line.
    std::string data;
  };

  void add(std::string type, std::string data);
  /// Wakes the streams; they end after the last event.
  void close();

  struct Read {
    std::vector<Event> events;
    /// How many after `last_id` are no longer kept.
    std::uint64_t missed = 0;
    /// Nothing will come after these.
    bool closed = false;
  };
  /// Those after `last_id`, once there are any or it is closed; waits at most so long.
  [[nodiscard]] Read after(std::uint64_t last_id, std::chrono::milliseconds most) const;

 private:
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  std::deque<Event> events_;
  std::uint64_t last_id_ = 0;
  bool closed_ = false;
};

/// As they travel: `id`, `event`, `data` (WHATWG HTML, 9.2 server-sent events).
[[nodiscard]] std::string to_stream(const SessionEvents::Read& read);

/// `Last-Event-ID` of a client that comes back. @return 0 for none or one that is no number of
/// ours: everything that is kept.
[[nodiscard]] std::uint64_t last_event_id(const std::string& header);

}  // namespace stillmap::server
