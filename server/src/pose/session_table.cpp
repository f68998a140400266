#include "pose/session_table.hpp"

#include "errors/api_error.hpp"

#include <fmt/format.h>

#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <utility>

namespace stillmap::server {
namespace {

/// 128 bits from the system, as 32 hex digits.
std::string random_id() {
  std::array<std::uint64_t, 2> bits{};
  // Up to 256 bytes come whole (getrandom(2)).
  if (::getrandom(bits.data(), sizeof(bits), 0) != static_cast<ssize_t>(sizeof(bits))) {
    throw std::runtime_error("getrandom gives no random bytes");
  }
  return fmt::format("{:016x}{:016x}", bits[0], bits[1]);
}

}  // namespace

SessionTable::SessionTable(const SessionLimits& limits, AlignmentQueue& queue,
                           std::function<Clock::time_point()> now)
    : limits_(limits), queue_(queue), now_(std::move(now)) {
  thread_ = std::jthread([this](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      expire();
      std::unique_lock lock(mutex_);
      stopping_.wait_for(lock, stop, std::chrono::seconds(1), [] { return false; });
    }
  });
}

SessionTable::~SessionTable() {
  thread_ = {};
  for (const auto& [id, session] : sessions_) session->close("stopped");
}

void SessionTable::require_room(const std::string& owner) const {
  const auto is_of = [&](const auto& each) { return each.second->owner() == owner; };
  const auto held =
      static_cast<std::size_t>(std::count_if(sessions_.begin(), sessions_.end(), is_of));
  const bool full = sessions_.size() >= static_cast<std::size_t>(limits_.most);
  const double share = owner.empty() ? 1.0 : limits_.client_share;
  const auto own = std::max<std::size_t>(1, static_cast<std::size_t>(share * limits_.most));
  if (!full && held < own) return;
  Clock::time_point oldest = now_();
  for (const auto& [id, session] : sessions_) oldest = std::min(oldest, session->last_used());
  const std::chrono::duration<double> left = oldest + limits_.idle - now_();
  throw ApiError(full ? ErrorCode::kBusy : ErrorCode::kTooManyRequests,
                 fmt::format("{} sessions are open, which is {}", full ? sessions_.size() : held,
                             full ? "the limit" : "this key's share"))
      .with_header("Retry-After", fmt::format("{}", std::max(1.0, std::ceil(left.count()))));
}

std::shared_ptr<Session> SessionTable::open(ServedVersion map, Session::Name name) {
  expire();
  const std::scoped_lock lock(mutex_);
  require_room(name.owner);
  name.id = random_id();
  auto session = std::make_shared<Session>(std::move(name), std::move(map), queue_);
  session->touch(now_());
  sessions_.emplace(session->id(), session);
  return session;
}

/// A foreign session is not told from none, so that nobody learns which there are.
SessionTable::Sessions::iterator SessionTable::find_locked(const std::string& id,
                                                           const std::string& owner) {
  const auto found = sessions_.find(id);
  const bool known = found != sessions_.end() && found->second->owner() == owner &&
                     now_() - found->second->last_used() <= limits_.idle;
  if (!known) {
    throw ApiError(ErrorCode::kUnknownSession, "there is no such session, or it has ended");
  }
  return found;
}

std::shared_ptr<Session> SessionTable::find(const std::string& id, const std::string& owner) {
  const std::scoped_lock lock(mutex_);
  std::shared_ptr<Session> session = find_locked(id, owner)->second;
  session->touch(now_());
  return session;
}

void SessionTable::close(const std::string& id, const std::string& owner,
                         const std::string& reason) {
  std::shared_ptr<Session> session;
  {
    const std::scoped_lock lock(mutex_);
    const auto found = find_locked(id, owner);
    session = found->second;
    sessions_.erase(found);
  }
  session->close(reason);
}

std::vector<std::shared_ptr<Session>> SessionTable::list(const std::optional<std::string>& owner) {
  expire();
  const std::scoped_lock lock(mutex_);
  std::vector<std::shared_ptr<Session>> own;
  for (const auto& [id, session] : sessions_) {
    if (!owner || session->owner() == *owner) own.push_back(session);
  }
  return own;
}

void SessionTable::expire() {
  std::vector<std::shared_ptr<Session>> ended;
  {
    const std::scoped_lock lock(mutex_);
    for (auto each = sessions_.begin(); each != sessions_.end();) {
      const bool idle = now_() - each->second->last_used() > limits_.idle;
      if (idle) ended.push_back(std::move(each->second));
      each = idle ? sessions_.erase(each) : std::next(each);
    }
  }
  // Outside of the lock: the last one to go may unload a map.
  for (const std::shared_ptr<Session>& each : ended) each->close("expired");
}

std::size_t SessionTable::size() const {
  const std::scoped_lock lock(mutex_);
  return sessions_.size();
}

std::size_t SessionTable::count_on(const std::string& map) const {
  const std::scoped_lock lock(mutex_);
  return static_cast<std::size_t>(
      std::count_if(sessions_.begin(), sessions_.end(),
                    [&](const auto& each) { return each.second->map().map == map; }));
}

}  // namespace stillmap::server
