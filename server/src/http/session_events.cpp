#include "http/session_events.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <utility>

namespace stillmap::server {

void SessionEvents::add(std::string type, std::string data) {
  const std::scoped_lock lock(mutex_);
  if (closed_) return;
  events_.push_back({++last_id_, std::move(type), std::move(data)});
  if (events_.size() > kKept) events_.pop_front();
  changed_.notify_all();
}

void SessionEvents::close() {
  const std::scoped_lock lock(mutex_);
  closed_ = true;
  changed_.notify_all();
}

SessionEvents::Read SessionEvents::after(std::uint64_t last_id,
                                         std::chrono::milliseconds most) const {
  std::unique_lock lock(mutex_);
  // A number that was never given comes from another session: it has seen nothing of this one.
  if (last_id > last_id_) last_id = 0;
  changed_.wait_for(lock, most, [&] { return last_id_ > last_id || closed_; });
  Read read;
  read.closed = closed_;
  const std::uint64_t first = last_id_ - events_.size() + 1;
  if (last_id + 1 < first) read.missed = first - last_id - 1;
  const std::uint64_t skipped = std::max(last_id + 1, first) - first;
  read.events.assign(events_.begin() + static_cast<std::ptrdiff_t>(skipped), events_.end());
  return read;
}

std::string to_stream(const SessionEvents::Read& read) {
  std::string text;
  if (read.missed > 0) {
    text += fmt::format("event: gap\ndata: {{\"missed\": {}}}\n\n", read.missed);
  }
  for (const SessionEvents::Event& each : read.events) {
    text += fmt::format("id: {}\nevent: {}\ndata: {}\n\n", each.id, each.type, each.data);
  }
  return text;
}

std::uint64_t last_event_id(const std::string& header) {
  std::uint64_t id = 0;
  const auto [end, error] = std::from_chars(header.data(), header.data() + header.size(), id);
  return error == std::errc{} && end == header.data() + header.size() ? id : 0;
}

}  // namespace stillmap::server
