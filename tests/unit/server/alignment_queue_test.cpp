#include "pose/alignment_queue.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "errors/api_error.hpp"

namespace stillmap::server {
namespace alignment_queue_test {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = AlignmentQueue::Clock;
using Reservation = AlignmentQueue::Reservation;
using Ticket = AlignmentQueue::Ticket;

AlignmentQueue::Work due_in(Clock::duration time, WorkKind kind = WorkKind::kNearPrior) {
  return {.kind = kind, .deadline = Clock::now() + time};
}

/// @return the code of what is thrown; fails when nothing is.
template <typename Call>
ErrorCode refusal(const Call& call) {
  try {
    static_cast<void>(call());
  } catch (const ApiError& error) {
    return error.code();
  }
  ADD_FAILURE() << "was taken";
  return ErrorCode::kInternalError;
}

/// A queue whose reservations are no matter of the test.
class Doors {
 public:
  explicit Doors(const QueueLimits& limits) : queue(limits) {}

  /// Enters as a request of its own on a thread of its own and says so when it is served.
  void send(const std::string& name, AlignmentQueue::Work work) {
    threads_.emplace_back([this, name, work] {
      try {
        const Reservation reservation = queue.reserve("", 1, work);
        const Ticket ticket = queue.enter(reservation, work);
        note(name);
      } catch (const ApiError& error) {
        note(name + " " + std::string(info_of(error.code()).text));
      }
    });
  }
  void wait_for(int waiting) const {
    while (queue.figures().waiting != waiting) std::this_thread::yield();
  }
  /// What became of them, in the order of their ends.
  std::vector<std::string> ends() {
    threads_.clear();
    return ends_;
  }
  void note(const std::string& name) {
    const std::scoped_lock lock(mutex_);
    ends_.push_back(name);
  }

  AlignmentQueue queue;

 private:
  std::mutex mutex_;
  std::vector<std::string> ends_;
  std::vector<std::jthread> threads_;
};

TEST(AlignmentQueue, RunsNoMoreThanItsWorkers) {
  Doors doors({.workers = 2, .waiting = 16});
  std::atomic<int> now = 0;
  std::atomic<int> most = 0;
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < 12; ++i) {
      threads.emplace_back([&] {
        const auto work = due_in(seconds(20));
        const Reservation reservation = doors.queue.reserve("", 1, work);
        const Ticket ticket = doors.queue.enter(reservation, work);
        const int here = ++now;
        for (int seen = most; here > seen && !most.compare_exchange_weak(seen, here);) {
        }
        std::this_thread::sleep_for(milliseconds(1));
        --now;
      });
    }
  }
  EXPECT_EQ(most, 2);
  EXPECT_EQ(doors.queue.figures().started, 12U);
  EXPECT_EQ(doors.queue.figures().requests, 0);
  EXPECT_EQ(doors.queue.figures().body_bytes, 0U);
}

TEST(AlignmentQueue, ServesTheEarliestDeadlineFirst) {
  Doors doors({.workers = 1, .waiting = 3});
  {
    const auto work = due_in(seconds(5));
    const Reservation reservation = doors.queue.reserve("", 1, work);
    const Ticket ticket = doors.queue.enter(reservation, work);
    int waiting = 0;
    for (const int due_s : {30, 10, 20}) {
      doors.send(std::to_string(due_s), due_in(seconds(due_s)));
      doors.wait_for(++waiting);
    }
  }
  EXPECT_EQ(doors.ends(), (std::vector<std::string>{"10", "20", "30"}));
}

TEST(AlignmentQueue, APlaceThatWasTakenOverCountsAsTheEarlierDeadline) {
  Doors doors({.workers = 1, .waiting = 3});
  {
    const auto work = due_in(seconds(5));
    const Reservation reservation = doors.queue.reserve("", 1, work);
    const Ticket ticket = doors.queue.enter(reservation, work);
    doors.send("first", due_in(seconds(10)));
    doors.wait_for(1);
    auto heir = due_in(seconds(30));
    heir.place = Clock::now() + seconds(8);
    doors.send("heir", heir);
    doors.wait_for(2);
  }
  EXPECT_EQ(doors.ends(), (std::vector<std::string>{"heir", "first"}));
}

TEST(AlignmentQueue, OneThatIsLateLeavesWithoutAWorker) {
  Doors doors({.workers = 1, .waiting = 3});
  const auto work = due_in(seconds(5));
  const Reservation reservation = doors.queue.reserve("", 1, work);
  {
    Ticket ticket = doors.queue.enter(reservation, work);
    // The estimate must not keep it out.
    ticket.scan_done(WorkKind::kNearPrior);
    doors.send("late", due_in(milliseconds(30)));
    doors.wait_for(1);
    doors.wait_for(0);
  }
  EXPECT_EQ(doors.ends(), (std::vector<std::string>{"late DeadlineExceeded"}));
  EXPECT_EQ(doors.queue.figures().started, 1U);
  EXPECT_EQ(doors.queue.figures().expired, 1U);
}

TEST(AlignmentQueue, ACancelledOneLeavesAtOnce) {
  Doors doors({.workers = 1, .waiting = 3});
  AlignmentQueue::Cancel cancel;
  const auto work = due_in(seconds(5));
  const Reservation reservation = doors.queue.reserve("", 1, work);
  const Ticket ticket = doors.queue.enter(reservation, work);
  auto old = due_in(seconds(60));
  old.cancel = &cancel;
  doors.send("old", old);
  doors.wait_for(1);
  doors.queue.cancel(cancel);
  EXPECT_EQ(doors.ends(), (std::vector<std::string>{"old Superseded"}));
  // One that comes after its cancellation does not wait either.
  EXPECT_EQ(refusal([&] { return doors.queue.enter(reservation, old); }), ErrorCode::kSuperseded);
}

TEST(AlignmentQueue, RefusesBeforeTheBodyIsReadWhenItIsFull) {
  AlignmentQueue queue({.workers = 1, .waiting = 0});
  const auto work = due_in(seconds(5));
  const Reservation first = queue.reserve("", 1, work);
  EXPECT_EQ(refusal([&] { return queue.reserve("", 1, work); }), ErrorCode::kBusy);
  const Ticket ticket = queue.enter(first, work);
  EXPECT_EQ(refusal([&] { return queue.reserve("", 1, work); }), ErrorCode::kBusy);
}

TEST(AlignmentQueue, RefusalsSayWhenToComeAgain) {
  AlignmentQueue queue({.workers = 1, .waiting = 0});
  const auto work = due_in(seconds(100), WorkKind::kReference);
  const Reservation first = queue.reserve("", 1, work);
  auto batch = work;
  batch.units = 7;
  const Ticket ticket = queue.enter(first, batch);
  try {
    static_cast<void>(queue.reserve("", 1, work));
    FAIL() << "was taken";
  } catch (const ApiError& error) {
    ASSERT_EQ(error.headers().size(), 1U);
    EXPECT_EQ(error.headers()[0].first, "Retry-After");
    // Seven scans, each guessed at a second.
    EXPECT_EQ(error.headers()[0].second, "7");
  }
}

TEST(AlignmentQueue, BodiesAreBoundedInNumberAndBytes) {
  AlignmentQueue queue({.workers = 4, .waiting = 16, .requests = 3, .body_bytes = 100});
  const auto work = due_in(seconds(5));
  EXPECT_EQ(refusal([&] { return queue.reserve("", 101, work); }), ErrorCode::kBusy);
  std::vector<Reservation> held;
  held.push_back(queue.reserve("", 60, work));
  EXPECT_EQ(refusal([&] { return queue.reserve("", 41, work); }), ErrorCode::kBusy);
  held.push_back(queue.reserve("", 40, work));
  held.push_back(queue.reserve("", 0, work));
  EXPECT_EQ(refusal([&] { return queue.reserve("", 0, work); }), ErrorCode::kBusy);
  EXPECT_EQ(queue.figures().body_bytes, 100U);
  held.pop_back();
  held.push_back(queue.reserve("", 0, work));
}

TEST(AlignmentQueue, AClientHoldsNoMoreThanItsShare) {
  AlignmentQueue queue({.workers = 2, .waiting = 4, .client_share = 0.5});
  const auto work = due_in(seconds(5));
  std::vector<Reservation> held;
  for (int i = 0; i < 3; ++i) held.push_back(queue.reserve("fleet", 1, work));
  EXPECT_EQ(refusal([&] { return queue.reserve("fleet", 1, work); }), ErrorCode::kTooManyRequests);
  held.push_back(queue.reserve("other", 1, work));
  // Nobody in particular has no share.
  held.push_back(queue.reserve("", 1, work));
  held.erase(held.begin());
  held.push_back(queue.reserve("fleet", 1, work));
}

TEST(AlignmentQueue, AClientsBodiesAreNoMoreThanItsShare) {
  AlignmentQueue queue({.workers = 4, .waiting = 16, .body_bytes = 100, .client_share = 0.5});
  const auto work = due_in(seconds(5));
  std::vector<Reservation> held;
  held.push_back(queue.reserve("fleet", 30, work));
  EXPECT_EQ(refusal([&] { return queue.reserve("fleet", 21, work); }), ErrorCode::kTooManyRequests);
  held.push_back(queue.reserve("fleet", 20, work));
  held.push_back(queue.reserve("other", 50, work));
  held.erase(held.begin());
  held.push_back(queue.reserve("fleet", 30, work));
}

TEST(AlignmentQueue, AShareIsAtLeastOneRequest) {
  AlignmentQueue queue({.workers = 1, .waiting = 0, .client_share = 0.1});
  const Reservation one = queue.reserve("fleet", std::size_t{256} << 20U, due_in(seconds(5)));
}

/// What is guessed before anything was measured: 20 ms a scan near a prior, 40 ms at most.
TEST(AlignmentQueue, RefusesAtOnceWhatTheWorkBeforeItWouldMakeLate) {
  const Clock::time_point start = Clock::now();
  AlignmentQueue queue({.workers = 1, .waiting = 16}, [&] { return start; });
  const auto due = [&](int ms) {
    return AlignmentQueue::Work{.deadline = start + milliseconds(ms)};
  };
  const Reservation first = queue.reserve("", 1, due(1000));
  const Ticket ticket = queue.enter(first, due(1000));
  EXPECT_EQ(refusal([&] { return queue.reserve("", 1, due(59)); }), ErrorCode::kBusy);
  const Reservation in_time = queue.reserve("", 1, due(61));
  // A body that is about to be there counts like one that is.
  EXPECT_EQ(refusal([&] { return queue.reserve("", 1, due(79)); }), ErrorCode::kBusy);
  const Reservation after_it = queue.reserve("", 1, due(81));
}

TEST(AlignmentQueue, WithNobodyBeforeItNoneIsRefused) {
  AlignmentQueue queue({.workers = 1, .waiting = 16});
  // Whatever the guess: only this way is a wrong one ever corrected.
  const auto work = due_in(milliseconds(500), WorkKind::kReference);
  const Reservation reservation = queue.reserve("", 1, work);
  const Ticket ticket = queue.enter(reservation, work);
}

TEST(AlignmentQueue, NobodyIsLetInWhoWouldMakeAnotherLate) {
  Doors doors({.workers = 1, .waiting = 16});
  {
    const auto work = due_in(seconds(60), WorkKind::kReference);
    const Reservation first = doors.queue.reserve("", 1, work);
    // Its head did not tell how dear it is.
    const Reservation second = doors.queue.reserve("", 1, due_in(seconds(60)));
    const Ticket ticket = doors.queue.enter(first, work);
    // Up to a second for the one that runs, three of its own.
    doors.send("admitted", due_in(milliseconds(4500), WorkKind::kReference));
    doors.wait_for(1);
    const auto urgent = due_in(milliseconds(4400), WorkKind::kReference);
    EXPECT_EQ(refusal([&] { return doors.queue.enter(second, urgent); }), ErrorCode::kBusy);
    // One that is content to wait is let in.
    auto patient = due_in(seconds(40), WorkKind::kReference);
    doors.send("patient", patient);
    doors.wait_for(2);
  }
  EXPECT_EQ(doors.ends(), (std::vector<std::string>{"admitted", "patient"}));
}

TEST(AlignmentQueue, SlowSendersDoNotKeepOthersOut) {
  Clock::time_point now = Clock::now();
  AlignmentQueue queue({.workers = 1, .waiting = 2}, [&] { return now; });
  const AlignmentQueue::Work work{.deadline = now + seconds(100)};
  std::vector<Reservation> held;
  for (int i = 0; i < 3; ++i) held.push_back(queue.reserve("", 1, work));
  EXPECT_EQ(refusal([&] { return queue.reserve("", 1, work); }), ErrorCode::kBusy);
  now += milliseconds(251);
  held.push_back(queue.reserve("", 1, work));
}

TEST(AlignmentQueue, ABatchLetsTheUrgentThrough) {
  Doors doors({.workers = 1, .waiting = 4});
  auto work = due_in(seconds(30));
  work.units = 2;
  const Reservation reservation = doors.queue.reserve("", 1, work);
  {
    Ticket batch = doors.queue.enter(reservation, work);
    doors.send("urgent", due_in(seconds(10)));
    doors.send("patient", due_in(seconds(40)));
    doors.wait_for(2);
    batch.scan_done(WorkKind::kNearPrior);
    batch.give_way();
    doors.note("batch");
  }
  EXPECT_EQ(doors.ends(), (std::vector<std::string>{"urgent", "batch", "patient"}));
}

TEST(AlignmentQueue, ABatchWaitsUntilTheDeadlineThatItsBodyTells) {
  Doors doors({.workers = 1, .waiting = 4});
  const auto work = due_in(milliseconds(100));
  const Reservation reservation = doors.queue.reserve("", 1, work);
  Ticket batch = doors.queue.enter(reservation, work);
  batch.set_deadline(Clock::now() + seconds(30));
  std::jthread urgent([&] {
    const auto sooner = due_in(seconds(10));
    const Reservation room = doors.queue.reserve("", 1, sooner);
    const Ticket ticket = doors.queue.enter(room, sooner);
    std::this_thread::sleep_for(milliseconds(200));
  });
  doors.wait_for(1);
  EXPECT_NO_THROW(batch.give_way());
  EXPECT_EQ(doors.queue.figures().started, 3U);
}

TEST(AlignmentQueue, OnlyFinishedScansAreMeasured) {
  Clock::time_point now = Clock::now();
  AlignmentQueue queue({.workers = 1, .waiting = 0}, [&] { return now; });
  const AlignmentQueue::Work work{.deadline = now + seconds(100)};
  const double guess = queue.figures().near_prior_mean_s;
  {
    const Reservation reservation = queue.reserve("", 1, work);
    const Ticket broken_scan = queue.enter(reservation, work);
  }
  EXPECT_EQ(queue.figures().near_prior_mean_s, guess);
  const Reservation reservation = queue.reserve("", 1, work);
  Ticket ticket = queue.enter(reservation, work);
  now += milliseconds(8);
  ticket.scan_done(WorkKind::kNearPrior);
  EXPECT_NEAR(queue.figures().near_prior_mean_s, 0.008, 1e-9);
}

TEST(ServiceTimes, FollowsAServerThatGotSlower) {
  ServiceTimes times;
  times.add(WorkKind::kNearPrior, 0.010);
  EXPECT_DOUBLE_EQ(times.mean_s(WorkKind::kNearPrior), 0.010);
  for (int i = 0; i < 50; ++i) times.add(WorkKind::kNearPrior, 0.020);
  EXPECT_NEAR(times.mean_s(WorkKind::kNearPrior), 0.020, 1e-4);
  EXPECT_NEAR(times.bound_s(WorkKind::kNearPrior), 0.020, 1e-3);
  // The others keep their own.
  EXPECT_GT(times.mean_s(WorkKind::kReference), 0.5);
}

TEST(ServiceTimes, KeepsItsFiguresFromNonsense) {
  ServiceTimes times;
  times.add(WorkKind::kEverywhere, -1.0);
  times.add(WorkKind::kEverywhere, std::numeric_limits<double>::quiet_NaN());
  times.add(WorkKind::kEverywhere, std::numeric_limits<double>::infinity());
  EXPECT_DOUBLE_EQ(times.mean_s(WorkKind::kEverywhere), 0.15);
}

TEST(AlignmentQueue, SaysWhichWorkersAreFarBeyondTheirDeadline) {
  Clock::time_point now = Clock::now();
  AlignmentQueue queue({.workers = 2}, [&] { return now; });
  const AlignmentQueue::Work short_work{.deadline = now + seconds(1)};
  const AlignmentQueue::Work long_work{.deadline = now + seconds(600)};
  const Reservation first = queue.reserve("", 1, short_work);
  const Reservation second = queue.reserve("", 1, long_work);
  const Ticket never_ends = queue.enter(first, short_work);
  const Ticket in_time = queue.enter(second, long_work);
  now += seconds(1) + AlignmentQueue::kStuckAfter;
  EXPECT_EQ(queue.figures().stuck, 0);
  now += milliseconds(1);
  EXPECT_EQ(queue.figures().stuck, 1);
}

}  // namespace alignment_queue_test
}  // namespace stillmap::server
