#include "pose/session_line.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <optional>
#include <string>
#include <thread>

#include "errors/api_error.hpp"

namespace stillmap::server {
namespace session_line_test {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = SessionLine::Clock;

template <typename Call>
std::string code_of(const Call& call) {
  try {
    call();
  } catch (const ApiError& error) {
    return std::string(info_of(error.code()).text);
  }
  return "taken";
}

class SessionLineTest : public ::testing::Test {
 protected:
  static Clock::time_point in(Clock::duration time) { return Clock::now() + time; }

  /// What becomes of a scan that goes all the way.
  std::string pass(std::int64_t stamp_ns, Clock::duration time = seconds(20)) {
    return code_of([&] {
      SessionLine::Scan scan(line_, stamp_ns, in(time));
      ++arrived_;
      scan.wait_for_turn();
      const auto work = scan.work(WorkKind::kNearPrior);
      const auto reservation = queue_.reserve("", 1, work);
      const auto ticket = queue_.enter(reservation, work);
      scan.begin();
    });
  }
  void wait_for_arrivals(int count) const {
    while (arrived_ < count) std::this_thread::yield();
  }

  AlignmentQueue queue_{{.workers = 1, .waiting = 4}};
  SessionLine line_{queue_};
  std::atomic<int> arrived_ = 0;
};

TEST_F(SessionLineTest, TheNewestOfThoseThatWaitIsServed) {
  std::string old_end;
  std::string new_end;
  std::optional<SessionLine::Scan> first;
  first.emplace(line_, 1, in(seconds(20)));
  first->begin();
  std::jthread older([&] { old_end = pass(2); });
  wait_for_arrivals(1);
  std::jthread newer([&] { new_end = pass(3); });
  older.join();
  EXPECT_EQ(old_end, "Superseded");
  first.reset();
  newer.join();
  EXPECT_EQ(new_end, "taken");
}

TEST_F(SessionLineTest, AnOlderOneDoesNotTakeTheNewerOnesPlace) {
  std::string end;
  std::optional<SessionLine::Scan> first;
  first.emplace(line_, 1, in(seconds(20)));
  first->begin();
  std::jthread waiting([&] { end = pass(5); });
  wait_for_arrivals(1);
  EXPECT_EQ(pass(4), "Superseded");
  first.reset();
  waiting.join();
  EXPECT_EQ(end, "taken");
}

TEST_F(SessionLineTest, OneThatWaitsForAWorkerIsReplacedAndItsPlaceInherited) {
  const AlignmentQueue::Work other{.deadline = in(seconds(20))};
  const auto reservation = queue_.reserve("", 1, other);
  std::optional<AlignmentQueue::Ticket> busy;
  busy.emplace(queue_.enter(reservation, other));
  std::string old_end;
  std::jthread older([&] { old_end = pass(2, seconds(10)); });
  while (queue_.figures().waiting != 1) std::this_thread::yield();
  SessionLine::Scan newer(line_, 3, in(seconds(30)));
  older.join();
  EXPECT_EQ(old_end, "Superseded");
  newer.wait_for_turn();
  const auto work = newer.work(WorkKind::kNearPrior);
  ASSERT_TRUE(work.place);
  EXPECT_LT(*work.place, in(seconds(11)));
  EXPECT_GT(work.deadline, in(seconds(28)));
}

TEST_F(SessionLineTest, OneThatIsBeingAlignedIsNotDisturbed) {
  SessionLine::Scan first(line_, 1, in(seconds(20)));
  first.begin();
  SessionLine::Scan second(line_, 2, in(seconds(20)));
  EXPECT_NO_THROW(first.require_place());
}

TEST_F(SessionLineTest, WaitingForTheSessionEndsAtTheDeadline) {
  SessionLine::Scan first(line_, 1, in(seconds(20)));
  first.begin();
  EXPECT_EQ(pass(2, milliseconds(20)), "DeadlineExceeded");
}

TEST_F(SessionLineTest, APauseEndsTheWaitingAndHoldsOffWhatComes) {
  std::string end;
  std::optional<SessionLine::Scan> first;
  first.emplace(line_, 1, in(seconds(20)));
  first->begin();
  std::jthread waiting([&] { end = pass(2); });
  wait_for_arrivals(1);
  std::optional<SessionLine::Pause> pause;
  std::jthread pausing([&] { pause.emplace(line_); });
  waiting.join();
  EXPECT_EQ(end, "Superseded");
  first.reset();
  pausing.join();
  EXPECT_EQ(pass(3, milliseconds(20)), "DeadlineExceeded");
  pause.reset();
  EXPECT_EQ(pass(1), "taken");
}

TEST_F(SessionLineTest, APauseTakesTheWorkerFromTheScanThatWaitsForOne) {
  const AlignmentQueue::Work other{.deadline = in(seconds(20))};
  const auto reservation = queue_.reserve("", 1, other);
  const auto busy = queue_.enter(reservation, other);
  std::string end;
  std::jthread waiting([&] { end = pass(2); });
  while (queue_.figures().waiting != 1) std::this_thread::yield();
  const SessionLine::Pause pause(line_);
  waiting.join();
  EXPECT_EQ(end, "Superseded");
}

TEST_F(SessionLineTest, ClosingEndsTheWaiting) {
  std::string end;
  SessionLine::Scan first(line_, 1, in(seconds(20)));
  first.begin();
  std::jthread waiting([&] { end = pass(2); });
  wait_for_arrivals(1);
  line_.close();
  waiting.join();
  EXPECT_EQ(end, "UnknownSession");
  EXPECT_EQ(pass(3), "UnknownSession");
}

}  // namespace session_line_test
}  // namespace stillmap::server
