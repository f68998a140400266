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
      throw ApiError(ErrorCode::kSuperseded,
                     "a newer scan of the session is waiting; do not send this one again");
    }
    place_ = std::min(deadline_, other->place_);
    line_.supersede("a newer scan of the session took this one's place; do not send it again");
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
  if (superseded_by_ != nullptr) throw ApiError(ErrorCode::kSuperseded, superseded_by_);
}

void SessionLine::Scan::require_place() const {
  const std::scoped_lock lock(line_.mutex_);
  check();
}

void SessionLine::Scan::wait_for_turn() {
  std::unique_lock lock(line_.mutex_);
  const bool in_time = line_.changed_.wait_until(lock, deadline_, [this] {
    return (!line_.aligning_ && line_.pauses_ == 0) || superseded_by_ != nullptr || line_.closed_;
  });
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

SessionLine::Pause::Pause(SessionLine& line) : line_(line) {
  std::unique_lock lock(line_.mutex_);
  ++line_.pauses_;
  line_.supersede("the session was initialized meanwhile; do not send this scan again");
  line_.changed_.wait(lock, [this] { return !line_.aligning_; });
}

SessionLine::Pause::~Pause() {
  const std::scoped_lock lock(line_.mutex_);
  --line_.pauses_;
  line_.changed_.notify_all();
}

/// The mutex is held. The scan that waits, if any, loses its place.
void SessionLine::supersede(const char* by) {
  if (waiting_ == nullptr) return;
  waiting_->superseded_by_ = by;
  queue_.cancel(waiting_->cancel_);
  waiting_ = nullptr;
  changed_.notify_all();
}

void SessionLine::close() {
  const std::scoped_lock lock(mutex_);
  closed_ = true;
  if (waiting_ != nullptr) queue_.cancel(waiting_->cancel_);
  changed_.notify_all();
}

}  // namespace stillmap::server
