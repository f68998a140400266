#include "alignment_gate.hpp"

#include "api_error.hpp"

namespace stillmap::server {

AlignmentGate::Ticket AlignmentGate::enter(
    std::optional<std::chrono::steady_clock::time_point> deadline) {
  std::unique_lock lock(mutex_);
  if (free_ == 0) {
    if (places_ == 0) {
      throw ApiError(ErrorCode::kBusy, "all workers are busy and the queue is full")
          .with_header("Retry-After", "1");
    }
    --places_;
    const auto is_free = [this] { return free_ > 0; };
    bool got = true;
    if (deadline) {
      got = freed_.wait_until(lock, *deadline, is_free);
    } else {
      freed_.wait(lock, is_free);
    }
    ++places_;
    if (!got)
      throw ApiError(ErrorCode::kDeadlineExceeded, "waited for a worker until the deadline");
  }
  --free_;
  return Ticket(*this);
}

void AlignmentGate::leave() {
  {
    const std::scoped_lock lock(mutex_);
    ++free_;
  }
  freed_.notify_one();
}

}  // namespace stillmap::server
