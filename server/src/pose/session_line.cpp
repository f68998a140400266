#include "pose/session_line.hpp"

#include "errors/api_error.hpp"

#include <algorithm>

namespace stillmap::server {

SessionLine::Scan::Scan(SessionLine& line, std::int64_t stamp_ns, Clock::time_point deadline)
    : line_(line), stamp_ns_(stamp_ns), deadline_(deadline), place_(deadline) {
  const std::scoped_lock lock(line_.mutex_);
  check();
  if (Scan* const other = line_.waiting_; other != nullptr) {
    if (other->stamp_ns_ > stamp_ns_) {
      throw ApiError(ErrorCode::kSuperseded, "a newer scan of the session is waiting");
    }
    place_ = std::min(deadline_, other->place_);
    other->superseded_ = true;
    line_.queue_.cancel(other->cancel_);
    line_.changed_.notify_all();
  }
  line_.waiting_ = this;
}

SessionLine::Scan::~Scan() {
  const std::scoped_lock lock(line_.mutex_);
  if (line_.waiting_ == this) line_.waiting_ = nullptr;
  if (begun_) {
    line_.aligning_ = false;
    line_.changed_.notify_all();
  }
}

/// The line's mutex is held.
void SessionLine::Scan::check() const {
  if (line_.closed_) throw ApiError(ErrorCode::kUnknownSession, "the session has ended");
  if (superseded_) {
    throw ApiError(ErrorCode::kSuperseded, "a newer scan of the session took this one's place");
  }
}

void SessionLine::Scan::require_place() const {
  const std::scoped_lock lock(line_.mutex_);
  check();
}

void SessionLine::Scan::wait_for_turn() {
  std::unique_lock lock(line_.mutex_);
  const bool in_time = line_.changed_.wait_until(
      lock, deadline_, [this] { return !line_.aligning_ || superseded_ || line_.closed_; });
  check();
  if (!in_time) {
    throw ApiError(ErrorCode::kDeadlineExceeded,
                   "waited for the session's last scan until the deadline");
  }
}

AlignmentQueue::Work SessionLine::Scan::work(WorkKind kind) {
  return {.kind = kind, .deadline = deadline_, .place = place_, .cancel = &cancel_};
}

void SessionLine::Scan::begin() {
  const std::scoped_lock lock(line_.mutex_);
  check();
  line_.waiting_ = nullptr;
  line_.aligning_ = true;
  begun_ = true;
}

void SessionLine::close() {
  const std::scoped_lock lock(mutex_);
  closed_ = true;
  if (waiting_ != nullptr) queue_.cancel(waiting_->cancel_);
  changed_.notify_all();
}

}  // namespace stillmap::server
