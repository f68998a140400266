#include "pose/alignment_queue.hpp"

#include "errors/api_error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace stillmap::server {
namespace {

using Seconds = std::chrono::duration<double>;

/// A body that has been on its way for longer comes from a slow sender, who must not keep others
/// out by announcing work.
constexpr std::chrono::milliseconds kImminent{250};

double seconds_of_clock(AlignmentQueue::Clock::time_point from,
                        AlignmentQueue::Clock::time_point to) {
  return std::max(0.0, Seconds(to - from).count());
}

ApiError late() { return {ErrorCode::kDeadlineExceeded, "waited for a worker until the deadline"}; }
ApiError superseded() {
  return {ErrorCode::kSuperseded,
          "a newer scan of the session took this one's place; do not send it again"};
}

}  // namespace

AlignmentQueue::Reservation::Reservation(Reservation&& other) noexcept
    : queue_(std::exchange(other.queue_, nullptr)), id_(other.id_) {}

AlignmentQueue::Reservation& AlignmentQueue::Reservation::operator=(Reservation&& other) noexcept {
  if (this == &other) return *this;
  release();
  queue_ = std::exchange(other.queue_, nullptr);
  id_ = other.id_;
  return *this;
}

void AlignmentQueue::Reservation::release() {
  if (queue_ != nullptr) std::exchange(queue_, nullptr)->release(id_);
}

AlignmentQueue::Ticket::~Ticket() {
  if (queue_ != nullptr) queue_->leave(id_);
}

AlignmentQueue::AlignmentQueue(const QueueLimits& limits, std::function<Clock::time_point()> now)
    : limits_(limits), now_(std::move(now)), free_(limits.workers) {
  const bool share = limits.client_share > 0.0 && limits.client_share <= 1.0;
  if (limits.workers < 1 || limits.waiting < 0 || limits.requests < 1 || !share) {
    throw std::invalid_argument("AlignmentQueue: workers, waiting, requests or client_share");
  }
}

double AlignmentQueue::cost_s(const Work& work) const {
  return times_.mean_s(work.kind) * work.units;
}

double AlignmentQueue::running_rest_s(Clock::time_point now) const {
  double rest = 0.0;
  for (const auto& [id, running] : running_) {
    const int left = std::max(1, running.work.units - running.done);
    const double whole = times_.mean_s(running.work.kind) * left;
    rest += std::max(0.0, whole - seconds_of_clock(running.since, now));
  }
  return rest;
}

double AlignmentQueue::imminent_s(Clock::time_point now, int& count) const {
  double cost = 0.0;
  for (const auto& [id, each] : reserved_) {
    if (each.entered || now - each.since > kImminent) continue;
    ++count;
    cost += each.cost_s;
  }
  return cost;
}

/// Whether work that starts after `ahead_s` of other work is done by its deadline.
bool AlignmentQueue::fits(const Work& work, Clock::time_point deadline, double ahead_s,
                          Clock::time_point now) const {
  const double wait = ahead_s / limits_.workers;
  const double own = times_.bound_s(work.kind) * work.units;
  return now + std::chrono::duration_cast<Clock::duration>(Seconds(wait + own)) <= deadline;
}

/// When what stands here now will be done, in whole seconds as the header has them.
std::string AlignmentQueue::retry_after(Clock::time_point now) const {
  int count = 0;
  double work = running_rest_s(now) + imminent_s(now, count);
  for (const Waiting* each : waiting_) work += each->cost_s;
  return fmt::format("{}", std::clamp(std::ceil(work / limits_.workers), 1.0, 60.0));
}

void AlignmentQueue::require_client_share(const std::string& client, std::size_t bytes,
                                          Clock::time_point now) {
  if (client.empty()) return;
  const int most = std::max(
      1, static_cast<int>(std::floor(limits_.client_share * (limits_.workers + limits_.waiting))));
  const auto most_bytes =
      static_cast<std::size_t>(limits_.client_share * static_cast<double>(limits_.body_bytes));
  const auto held = held_.find(client);
  if (held == held_.end()) return;
  const auto& [requests, held_bytes] = held->second;
  if (requests < most && held_bytes + bytes <= most_bytes) return;
  ++totals_.refused_client;
  throw ApiError(
      ErrorCode::kTooManyRequests,
      fmt::format("{} requests of this key, with {} bytes, are being served or wait; "
                  "its share is {} requests and {} bytes; send again when some are answered",
                  requests, held_bytes, most, most_bytes))
      .with_header("Retry-After", retry_after(now));
}

/// The work before this one must leave it in time, and it those that come after it.
void AlignmentQueue::require_fit(const Work& work, Clock::time_point order, double imminent,
                                 Clock::time_point now) {
  double ahead = running_rest_s(now) + imminent;
  bool fit = true;
  bool placed = false;
  bool anyone = free_ == 0 || imminent > 0.0;
  for (const Waiting* each : waiting_) {
    anyone = true;
    if (!placed && order < each->order) {
      placed = true;
      fit = fit && fits(work, work.deadline, ahead, now);
      ahead += cost_s(work);
    }
    if (placed) fit = fit && fits(each->work, each->work.deadline, ahead, now);
    ahead += each->cost_s;
  }
  if (!placed) fit = fit && fits(work, work.deadline, ahead, now);
  if (fit || !anyone) return;
  ++totals_.refused_busy;
  throw ApiError(
      ErrorCode::kBusy,
      "overloaded: this request cannot finish before its deadline, or would make another one miss "
      "its own; send it again after Retry-After, or with a longer deadline_ms")
      .with_header("Retry-After", retry_after(now));
}

AlignmentQueue::Reservation AlignmentQueue::reserve(const std::string& client, std::size_t bytes,
                                                    const Work& work) {
  const std::scoped_lock lock(mutex_);
  const Clock::time_point now = now_();
  require_client_share(client, bytes, now);
  int coming = 0;
  const double imminent = imminent_s(now, coming);
  const bool full = coming + static_cast<int>(waiting_.size()) >= limits_.waiting + free_;
  const bool unbounded = static_cast<int>(reserved_.size()) < limits_.requests &&
                         bytes <= limits_.body_bytes && body_bytes_ <= limits_.body_bytes - bytes;
  if (full || !unbounded) {
    ++totals_.refused_busy;
    throw ApiError(
        ErrorCode::kBusy,
        full
            ? "all workers are busy and the queue is full; send the request again after Retry-After"
            : "too many requests are being received; send the request again after Retry-After")
        .with_header("Retry-After", retry_after(now));
  }
  require_fit(work, work.place.value_or(work.deadline), imminent, now);
  Reservation reservation;
  reservation.queue_ = this;
  reservation.id_ = next_id_++;
  reserved_.emplace(
      reservation.id_,
      Reserved{.client = client, .bytes = bytes, .cost_s = cost_s(work), .since = now});
  if (!client.empty()) {
    Held& held = held_[client];
    ++held.requests;
    held.bytes += bytes;
  }
  body_bytes_ += bytes;
  return reservation;
}

void AlignmentQueue::release(std::uint64_t id) {
  const std::scoped_lock lock(mutex_);
  const auto found = reserved_.find(id);
  body_bytes_ -= found->second.bytes;
  const auto held = held_.find(found->second.client);
  if (held != held_.end()) {
    held->second.bytes -= found->second.bytes;
    if (--held->second.requests == 0) held_.erase(held);
  }
  reserved_.erase(found);
}

void AlignmentQueue::start(std::uint64_t id, const Work& work) {
  --free_;
  running_.emplace(id, Running{.work = work, .since = now_()});
  ++totals_.started;
}

AlignmentQueue::Ticket AlignmentQueue::enter(const Reservation& reservation, const Work& work) {
  std::unique_lock lock(mutex_);
  const Clock::time_point now = now_();
  if (work.cancel != nullptr && work.cancel->requested_) {
    ++totals_.superseded;
    throw superseded();
  }
  if (const auto found = reserved_.find(reservation.id_);
      reservation.queue_ == this && found != reserved_.end()) {
    found->second.entered = true;
  }
  if (now > work.deadline) {
    ++totals_.expired;
    throw late();
  }
  const std::uint64_t id = next_id_++;
  if (free_ > 0) {
    start(id, work);
    return Ticket(*this, id);
  }
  if (static_cast<int>(waiting_.size()) >= limits_.waiting) {
    ++totals_.refused_busy;
    throw ApiError(
        ErrorCode::kBusy,
        "all workers are busy and the queue is full; send the request again after Retry-After")
        .with_header("Retry-After", retry_after(now));
  }
  Waiting waiting{.order = std::min(work.deadline, work.place.value_or(work.deadline)),
                  .id = id,
                  .work = work,
                  .cost_s = cost_s(work)};
  require_fit(work, waiting.order, 0.0, now);
  wait_for_worker(lock, waiting);
  return Ticket(*this, id);
}

/// @throws ApiError as `enter`; otherwise the worker is had.
void AlignmentQueue::wait_for_worker(std::unique_lock<std::mutex>& lock, Waiting& waiting) {
  waiting_.insert(&waiting);
  Cancel* const cancel = waiting.work.cancel;
  if (cancel != nullptr) cancel->wake_ = &waiting.wake;
  const auto done = [&] {
    return waiting.chosen || waiting.expired || (cancel != nullptr && cancel->requested_);
  };
  waiting.wake.wait_until(lock, waiting.work.deadline, done);
  if (cancel != nullptr) cancel->wake_ = nullptr;
  if (waiting.chosen) return;
  waiting_.erase(&waiting);
  if (cancel != nullptr && cancel->requested_) {
    ++totals_.superseded;
    throw superseded();
  }
  ++totals_.expired;
  throw late();
}

/// Gives free workers to those that wait; one that is late costs none.
void AlignmentQueue::hand_over() {
  while (free_ > 0 && !waiting_.empty()) {
    Waiting& next = **waiting_.begin();
    waiting_.erase(waiting_.begin());
    if (now_() > next.work.deadline) {
      next.expired = true;
    } else {
      next.chosen = true;
      start(next.id, next.work);
    }
    next.wake.notify_one();
  }
}

void AlignmentQueue::leave(std::uint64_t id) {
  const std::scoped_lock lock(mutex_);
  running_.erase(id);
  ++free_;
  hand_over();
}

void AlignmentQueue::Ticket::scan_done(WorkKind kind) {
  const std::scoped_lock lock(queue_->mutex_);
  Running& running = queue_->running_.at(id_);
  const Clock::time_point now = queue_->now_();
  queue_->times_.add(kind, seconds_of_clock(running.since, now));
  running.since = now;
  ++running.done;
}

void AlignmentQueue::Ticket::set_deadline(Clock::time_point deadline) {
  const std::scoped_lock lock(queue_->mutex_);
  queue_->running_.at(id_).work.deadline = deadline;
}

void AlignmentQueue::Ticket::give_way() {
  if (queue_ == nullptr) throw late();
  AlignmentQueue& queue = *queue_;
  std::unique_lock lock(queue.mutex_);
  Running mine = queue.running_.at(id_);
  const Clock::time_point order =
      std::min(mine.work.deadline, mine.work.place.value_or(mine.work.deadline));
  if (queue.waiting_.empty() || (*queue.waiting_.begin())->order >= order) return;
  // Of a batch in JSON it was not known how many scans it holds.
  mine.work.units = std::max(1, mine.work.units - mine.done);
  Waiting waiting{.order = order, .id = id_, .work = mine.work, .cost_s = queue.cost_s(mine.work)};
  queue.running_.erase(id_);
  ++queue.free_;
  queue_ = nullptr;
  queue.hand_over();
  // Another free worker may be left when those that waited were late.
  if (queue.free_ > 0) {
    queue.start(id_, mine.work);
  } else {
    queue.wait_for_worker(lock, waiting);
  }
  queue_ = &queue;
}

void AlignmentQueue::cancel(Cancel& cancel) {
  const std::scoped_lock lock(mutex_);
  cancel.requested_ = true;
  if (cancel.wake_ != nullptr) cancel.wake_->notify_one();
}

AlignmentQueue::Figures AlignmentQueue::figures() const {
  const std::scoped_lock lock(mutex_);
  Figures figures = totals_;
  figures.running = static_cast<int>(running_.size());
  const Clock::time_point now = now_();
  for (const auto& [id, running] : running_)
    if (now - running.work.deadline > kStuckAfter) ++figures.stuck;
  figures.waiting = static_cast<int>(waiting_.size());
  figures.requests = static_cast<int>(reserved_.size());
  figures.body_bytes = body_bytes_;
  figures.near_prior_mean_s = times_.mean_s(WorkKind::kNearPrior);
  return figures;
}

}  // namespace stillmap::server
