#pragma once

#include "pose/session.hpp"

#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace stillmap::server {

struct SessionLimits {
  /// Open at one time, >= 1.
  int most = 256;
  /// Not used for so long, a session ends.
  std::chrono::seconds idle{60};
  /// Share of them that one key may hold, in (0, 1]; at least one.
  double client_share = 0.5;
};

/// The open sessions. Their names are 128 random bits, and only the key that opened one finds it.
/// Safe from several threads.
class SessionTable {
 public:
  using Clock = Session::Clock;

  /// @param queue  outlives this. @param now  for tests.
  SessionTable(const SessionLimits& limits, AlignmentQueue& queue,
               std::function<Clock::time_point()> now = Clock::now);
  /// Ends all sessions.
  ~SessionTable();
  SessionTable(const SessionTable&) = delete;
  SessionTable& operator=(const SessionTable&) = delete;

  /// @param map  ready. @throws ApiError kBusy or kTooManyRequests, with Retry-After.
  /// @param name  its id is made here.
  std::shared_ptr<Session> open(ServedVersion map, Session::Name name);
  /// Counts as use. @throws ApiError kUnknownSession.
  [[nodiscard]] std::shared_ptr<Session> find(const std::string& id, const std::string& owner);
  /// @throws ApiError kUnknownSession.
  void close(const std::string& id, const std::string& owner,
             const std::string& reason = "deleted");
  /// The owner's, by id. @param owner  nothing: of all.
  [[nodiscard]] std::vector<std::shared_ptr<Session>> list(const std::optional<std::string>& owner);
  /// Sessions of all owners on a map.
  [[nodiscard]] std::size_t count_on(const std::string& map) const;
  /// Ends those that have not been used for too long; happens by itself every second.
  void expire();

  [[nodiscard]] const SessionLimits& limits() const { return limits_; }
  [[nodiscard]] std::size_t size() const;

 private:
  using Sessions = std::map<std::string, std::shared_ptr<Session>>;

  [[nodiscard]] Sessions::iterator find_locked(const std::string& id, const std::string& owner);
  void require_room(const std::string& owner) const;

  SessionLimits limits_;
  AlignmentQueue& queue_;
  std::function<Clock::time_point()> now_;
  mutable std::mutex mutex_;
  std::condition_variable_any stopping_;
  Sessions sessions_;
  std::jthread thread_;  // last: it uses all of the above
};

}  // namespace stillmap::server
