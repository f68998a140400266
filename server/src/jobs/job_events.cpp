#include "jobs/job_events.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

namespace stillmap::server {

void JobEvents::add(std::string type, std::string data, std::int64_t now_ns) {
  const std::scoped_lock lock(mutex_);
  if (closed_) return;
  const std::uint64_t last = events_.empty() ? 0 : events_.back().id;
  events_.push_back({std::max(last + 1, event_id_at(now_ns)), std::move(type), std::move(data)});
  if (events_.size() > kKept) events_.pop_front();
  changed_.notify_all();
}

void JobEvents::close() {
  const std::scoped_lock lock(mutex_);
  closed_ = true;
  changed_.notify_all();
}

SessionEvents::Read JobEvents::after(std::uint64_t last_id, std::chrono::milliseconds most) const {
  std::unique_lock lock(mutex_);
  const auto is_newer = [&] { return !events_.empty() && events_.back().id > last_id; };
  changed_.wait_for(lock, most, [&] { return closed_ || is_newer(); });
  SessionEvents::Read read;
  read.closed = closed_;
  std::copy_if(events_.begin(), events_.end(), std::back_inserter(read.events),
               [&](const auto& event) { return event.id > last_id; });
  return read;
}

std::uint64_t event_id_at(std::int64_t time_ns) {
  constexpr std::int64_t kPerMs = 1'000'000;
  return static_cast<std::uint64_t>(std::max<std::int64_t>(time_ns / kPerMs, 1));
}

}  // namespace stillmap::server
