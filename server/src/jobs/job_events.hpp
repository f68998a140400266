#pragma once

#include "http/session_events.hpp"

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <string>

namespace stillmap::server {

/// What happened to one job that has not ended, the newest of it: each event tells its whole
/// state, so that nobody misses anything by missing some. Their numbers are the time [ms since
/// 1970], or one more than the last: they grow over restarts of the server too. Safe from several
/// threads.
class JobEvents {
 public:
  static constexpr std::size_t kKept = 64;

  /// @param data  JSON on one line.
  void add(std::string type, std::string data, std::int64_t now_ns);
  /// Wakes those who wait; they end after the last event.
  void close();
  /// Those after `last_id`, once there are any or it is closed; waits at most so long.
  [[nodiscard]] SessionEvents::Read after(std::uint64_t last_id,
                                          std::chrono::milliseconds most) const;

 private:
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  std::deque<SessionEvents::Event> events_;
  bool closed_ = false;
};

/// The number of an event of this time.
[[nodiscard]] std::uint64_t event_id_at(std::int64_t time_ns);

}  // namespace stillmap::server
