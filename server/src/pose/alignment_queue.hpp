#pragma once

#include "pose/service_times.hpp"

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>

namespace stillmap::server {

/// How much an `AlignmentQueue` takes at one time.
struct QueueLimits {
  /// Alignments that run, >= 1.
  int workers = 1;
  /// Requests that wait for a worker with their bodies in memory, >= 0.
  int waiting = 16;
  /// Requests whose bodies are being read, that wait or run, >= 1.
  int requests = 64;
  /// Their bodies together [bytes].
  std::size_t body_bytes = std::size_t{256} << 20U;
  /// Share of the running and waiting, and of the bytes, that one client may hold, in (0, 1]; at
  /// least one request.
  double client_share = 0.5;
};

/// Lets a bounded number of alignments run and a bounded number wait, earliest deadline first, so
/// that load turns into early refusals instead of ever longer answers.
///
/// A request passes two doors. `reserve` stands before its body is read: it refuses at the cost of
/// a header what would not be answered in time anyway. `enter` waits for a worker; decoding and
/// aligning happen while the ticket is held, on the caller's thread, so that no more than `workers`
/// threads work at one time. A request is refused when the work before it, by the running means of
/// what scans cost, would make it late or would make one late that was let in before. With nobody
/// before it none is refused, so a wrong estimate is measured anew instead of being kept for ever.
/// Safe from several threads.
class AlignmentQueue {
 public:
  using Clock = std::chrono::steady_clock;
  /// No alignment takes nearly as long: a worker that is so late will not come back by itself.
  static constexpr std::chrono::seconds kStuckAfter{60};

  /// Takes a waiting request out of the queue from another thread. Lives longer than the wait.
  class Cancel {
    friend class AlignmentQueue;
    bool requested_ = false;
    std::condition_variable* wake_ = nullptr;
  };

  struct Work {
    WorkKind kind = WorkKind::kNearPrior;
    /// Scans.
    int units = 1;
    /// The answer is of no use later.
    Clock::time_point deadline;
    /// Waits as if its deadline were this, when earlier: it took another's place.
    std::optional<Clock::time_point> place{};
    Cancel* cancel = nullptr;
  };

  /// Room for one request, from before its body is read until it is answered.
  class Reservation {
   public:
    Reservation() = default;
    Reservation(Reservation&& other) noexcept;
    Reservation& operator=(Reservation&& other) noexcept;
    Reservation(const Reservation&) = delete;
    Reservation& operator=(const Reservation&) = delete;
    ~Reservation() { release(); }

   private:
    friend class AlignmentQueue;
    void release();

    AlignmentQueue* queue_ = nullptr;
    std::uint64_t id_ = 0;
  };

  /// A worker; goes back when the ticket goes.
  class Ticket {
   public:
    Ticket(Ticket&& other) noexcept : queue_(other.queue_), id_(other.id_) {
      other.queue_ = nullptr;
    }
    Ticket(const Ticket&) = delete;
    Ticket& operator=(const Ticket&) = delete;
    Ticket& operator=(Ticket&&) = delete;
    ~Ticket();

    /// One scan has been aligned: the time since the worker was had, or since the last scan, is
    /// what such a scan costs. What broke off before tells nothing and is not counted.
    /// @param kind  as the body told it.
    void scan_done(WorkKind kind);
    /// What the body says of it, where that is read by the worker.
    void set_deadline(Clock::time_point deadline);
    /// Between two scans of one request: lets those run that have an earlier deadline.
    /// @throws ApiError kDeadlineExceeded when its own passes meanwhile; then it holds no worker.
    void give_way();

   private:
    friend class AlignmentQueue;
    Ticket(AlignmentQueue& queue, std::uint64_t id) : queue_(&queue), id_(id) {}

    AlignmentQueue* queue_;
    std::uint64_t id_;
  };

  /// What stands in it now, and what it did since it was made.
  struct Figures {
    int running = 0;
    /// Of those, how many are more than `kStuckAfter` beyond their deadline.
    int stuck = 0;
    int waiting = 0;
    int requests = 0;
    std::size_t body_bytes = 0;
    double near_prior_mean_s = 0.0;
    std::uint64_t started = 0;
    std::uint64_t refused_busy = 0;
    std::uint64_t refused_client = 0;
    std::uint64_t expired = 0;
    std::uint64_t superseded = 0;
  };

  /// @param now  for tests.
  explicit AlignmentQueue(const QueueLimits& limits,
                          std::function<Clock::time_point()> now = Clock::now);

  /// @param client  who asks, such as the id of a key; empty = nobody in particular, no share.
  /// @param bytes   of the body, as it will lie in memory.
  /// @param work    as far as the head tells it.
  /// @throws ApiError kBusy, kTooManyRequests with Retry-After.
  [[nodiscard]] Reservation reserve(const std::string& client, std::size_t bytes, const Work& work);

  /// Waits for a worker, at most until the deadline.
  /// @throws ApiError kBusy with Retry-After; kDeadlineExceeded; kSuperseded when cancelled.
  [[nodiscard]] Ticket enter(const Reservation& reservation, const Work& work);

  /// A request that waits, or is about to, stops waiting with kSuperseded.
  void cancel(Cancel& cancel);

  [[nodiscard]] Figures figures() const;

 private:
  struct Reserved {
    std::string client;
    std::size_t bytes;
    double cost_s;
    Clock::time_point since;
    bool entered = false;
  };
  struct Held {
    int requests = 0;
    std::size_t bytes = 0;
  };
  struct Waiting {
    Clock::time_point order;
    std::uint64_t id;
    Work work;
    double cost_s;
    bool chosen = false;
    bool expired = false;
    std::condition_variable wake{};
  };
  struct Running {
    Work work;
    /// When its present scan began.
    Clock::time_point since;
    int done = 0;
  };
  struct Earlier {
    bool operator()(const Waiting* a, const Waiting* b) const {
      return a->order != b->order ? a->order < b->order : a->id < b->id;
    }
  };

  [[nodiscard]] double cost_s(const Work& work) const;
  [[nodiscard]] double running_rest_s(Clock::time_point now) const;
  [[nodiscard]] double imminent_s(Clock::time_point now, int& count) const;
  [[nodiscard]] bool fits(const Work& work, Clock::time_point order, double ahead_s,
                          Clock::time_point now) const;
  [[nodiscard]] std::string retry_after(Clock::time_point now) const;
  void require_client_share(const std::string& client, std::size_t bytes, Clock::time_point now);
  void require_fit(const Work& work, Clock::time_point order, double imminent,
                   Clock::time_point now);
  void wait_for_worker(std::unique_lock<std::mutex>& lock, Waiting& waiting);
  void start(std::uint64_t id, const Work& work);
  void hand_over();
  void leave(std::uint64_t id);
  void release(std::uint64_t id);

  QueueLimits limits_;
  std::function<Clock::time_point()> now_;
  mutable std::mutex mutex_;
  ServiceTimes times_;
  int free_;
  std::uint64_t next_id_ = 1;
  std::map<std::uint64_t, Reserved> reserved_;
  /// Of clients that hold any.
  std::map<std::string, Held> held_;
  std::size_t body_bytes_ = 0;
  std::set<Waiting*, Earlier> waiting_;
  std::map<std::uint64_t, Running> running_;
  Figures totals_;
};

}  // namespace stillmap::server
