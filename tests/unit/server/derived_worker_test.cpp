#include "derived/derived_worker.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace stillmap::server {
namespace derived_worker_test {

using State = DerivedWorker::State;
using Turn = DerivedWorker::Turn;

/// Keeps a worker busy until it is let go; outlives it.
class Busy {
 public:
  void begin(DerivedWorker& worker) {
    (void)worker.ask("busy", [this](const maps::DerivedWork&) {
      std::unique_lock lock(mutex_);
      begun_ = true;
      changed_.notify_all();
      changed_.wait(lock, [this] { return may_end_; });
    });
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return begun_; });
  }
  void let_go() {
    const std::scoped_lock lock(mutex_);
    may_end_ = true;
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool begun_ = false, may_end_ = false;
};

void nothing(const maps::DerivedWork& /*how*/) {}

TEST(DerivedWorker, MakesOneAfterTheOtherAndTellsHowFarItIs) {
  DerivedWorker worker;
  std::mutex mutex;
  std::condition_variable changed;
  bool begun = false;
  bool may_end = false;
  int made = 0;
  const auto work = [&](const maps::DerivedWork& how) {
    EXPECT_EQ(how.threads, 1U);
    EXPECT_TRUE(how.go_on(0.25));
    std::unique_lock lock(mutex);
    begun = true;
    changed.notify_all();
    changed.wait(lock, [&] { return may_end; });
    ++made;
  };
  EXPECT_EQ(worker.ask("a", work).state, State::kMaking);
  {
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return begun; });
  }
  EXPECT_EQ(worker.ask("a", work).progress, 0.25);
  for (std::size_t i = 0; i < DerivedWorker::kMostWaiting; ++i)
    EXPECT_EQ(worker.ask("b" + std::to_string(i), [](const auto&) {}).state, State::kMaking);
  EXPECT_EQ(worker.ask("one more", work).state, State::kFull);
  EXPECT_EQ(worker.ask("b0", work).state, State::kMaking);
  const std::scoped_lock lock(mutex);
  EXPECT_EQ(made, 0);
  may_end = true;
  changed.notify_all();
}

TEST(DerivedWorker, WhatFailedIsNotTriedAgainBeforeItsPauseIsOver) {
  DerivedWorker worker(std::chrono::hours{1});
  std::atomic<int> tries = 0;
  const auto work = [&](const maps::DerivedWork&) {
    ++tries;
    throw std::runtime_error("no room");
  };
  DerivedWorker::Answer answer;
  while ((answer = worker.ask("a", work)).state == State::kMaking)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(answer.state, State::kFailed);
  EXPECT_EQ(answer.failure, "no room");
  EXPECT_EQ(tries, 1);

  DerivedWorker hasty(std::chrono::milliseconds{0});
  while (tries < 4) {
    (void)hasty.ask("a", work);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

TEST(DerivedWorker, GoesOnWhateverIsThrown) {
  DerivedWorker worker;
  const auto throws = [](const maps::DerivedWork&) { throw 7; };  // NOLINT: no exception of ours
  while (worker.ask("odd", throws).state != DerivedWorker::State::kFailed)
    std::this_thread::yield();
  std::atomic<bool> made = false;
  (void)worker.ask("next", [&](const maps::DerivedWork&) { made = true; });
  while (!made) std::this_thread::yield();
}

TEST(DerivedWorker, EndStopsWhatIsUnderWayAndForgetsTheRest) {
  std::atomic<bool> stopped = false;
  std::atomic<bool> begun = false;
  bool never = true;
  {
    DerivedWorker worker;
    (void)worker.ask("a", [&](const maps::DerivedWork& how) {
      begun = true;
      while (how.go_on(0.0)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      stopped = true;
      throw maps::WorkStopped();
    });
    (void)worker.ask("b", [&](const maps::DerivedWork&) { never = false; });
    while (!begun) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(stopped);
  EXPECT_TRUE(never);
}

TEST(DerivedWorker, WhatGoesAfterLeavesItsPlacesToWhatGoesFirst) {
  Busy busy;
  DerivedWorker worker;
  busy.begin(worker);
  for (std::size_t i = 0; i < DerivedWorker::kMostAfter; ++i)
    EXPECT_EQ(worker.ask("after " + std::to_string(i), nothing, Turn::kAfter).state,
              State::kMaking);
  EXPECT_EQ(worker.ask("one more", nothing, Turn::kAfter).state, State::kFull);
  EXPECT_EQ(worker.ask("after 0", nothing, Turn::kAfter).state, State::kMaking) << "it waits";
  for (std::size_t i = 0; i < DerivedWorker::kMostWaiting; ++i)
    EXPECT_EQ(worker.ask("first " + std::to_string(i), nothing).state, State::kMaking);
  EXPECT_EQ(worker.ask("one more", nothing).state, State::kFull);
  busy.let_go();
}

TEST(DerivedWorker, WhatGoesFirstIsMadeBeforeWhatWaitedLonger) {
  std::vector<std::string> made;
  std::atomic<bool> done = false;
  Busy busy;
  DerivedWorker worker;
  busy.begin(worker);
  const auto noted = [&](const std::string& name) {
    return [&made, name](const maps::DerivedWork&) { made.push_back(name); };
  };
  (void)worker.ask("difference", noted("difference"), Turn::kAfter);
  (void)worker.ask("levels", noted("levels"));
  (void)worker.ask(
      "end", [&](const maps::DerivedWork&) { done = true; }, Turn::kAfter);
  (void)worker.ask("other levels", noted("other levels"));
  busy.let_go();
  while (!done) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_THAT(made, ::testing::ElementsAre("levels", "other levels", "difference"));
}

}  // namespace derived_worker_test
}  // namespace stillmap::server
