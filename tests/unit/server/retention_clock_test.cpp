#include "jobs/housekeeping.hpp"

#include <gmock/gmock.h>

#include <chrono>
#include <filesystem>

#include "service_fixture.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::server {
namespace retention_clock_test {

using Steady = std::chrono::steady_clock;
using std::chrono::hours;

constexpr std::int64_t kHour_ns = std::int64_t{3600} * 1'000'000'000;
constexpr std::int64_t kDay_ns = 24 * kHour_ns;
constexpr std::int64_t kToday = 20'000 * kDay_ns;

class RetentionClockTest : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "retention-clock";
  Steady::time_point steady_{};
};

TEST_F(RetentionClockTest, IsTheClockOfAServerThatRunsEveryDay) {
  {
    RetentionClock clock(file_, 0);
    EXPECT_EQ(clock.now_ns(kToday, steady_), kToday) << "a store without anything";
    EXPECT_EQ(clock.now_ns(kToday + kHour_ns, steady_ + hours(1)), kToday + kHour_ns);
  }
  RetentionClock again(file_, 0);
  EXPECT_EQ(again.now_ns(kToday + kDay_ns, steady_), kToday + kDay_ns) << "off for a night";
}

TEST_F(RetentionClockTest, CountsOnlyTheTimeThatItRunsWhereTheClockIsFarAhead) {
  RetentionClock(file_, 0).now_ns(kToday, steady_);
  const std::int64_t ahead = kToday + 800 * kDay_ns;
  for (int start = 0; start < 3; ++start) {
    RetentionClock wrong(file_, ahead);
    EXPECT_EQ(wrong.now_ns(ahead, steady_), kToday + start * kHour_ns)
        << "rows of then tell nothing";
    EXPECT_EQ(wrong.now_ns(ahead + kHour_ns, steady_ + hours(1)), kToday + (start + 1) * kHour_ns);
  }
  RetentionClock mended(file_, 0);
  EXPECT_EQ(mended.now_ns(kToday + 5 * kHour_ns, steady_), kToday + 5 * kHour_ns);
}

TEST_F(RetentionClockTest, DoesNotFollowAClockThatJumpsWhileItRuns) {
  RetentionClock clock(file_, 0);
  clock.now_ns(kToday, steady_);
  EXPECT_EQ(clock.now_ns(kToday + 800 * kDay_ns, steady_ + hours(1)), kToday + kHour_ns);
  EXPECT_EQ(clock.now_ns(kToday - 9 * kDay_ns, steady_ + hours(2)), kToday - 9 * kDay_ns)
      << "what is old by a clock that was set back is older still by another";
  EXPECT_EQ(clock.now_ns(kToday + 3 * kHour_ns, steady_ + hours(3)), kToday + 3 * kHour_ns);
}

// A server that was off for some days, or began before its clock was set.
TEST_F(RetentionClockTest, BelievesAClockThatGoesOnForThreeDays) {
  RetentionClock clock(file_, kToday - 30 * kDay_ns);
  for (int hour = 0; hour < 72; ++hour)
    EXPECT_EQ(clock.now_ns(kToday + hour * kHour_ns, steady_ + hours(hour)),
              kToday - 30 * kDay_ns + hour * kHour_ns);
  EXPECT_EQ(clock.now_ns(kToday + 72 * kHour_ns, steady_ + hours(72)), kToday + 72 * kHour_ns);
  EXPECT_EQ(clock.now_ns(kToday + 800 * kDay_ns, steady_ + hours(73)), kToday + 73 * kHour_ns)
      << "a jump is looked at anew";
}

TEST_F(RetentionClockTest, BeginsAtTheNewestRowOfAStoreThatHadNone) {
  RetentionClock clock(file_, kToday - 30 * kDay_ns);
  EXPECT_EQ(clock.now_ns(kToday, steady_), kToday - 30 * kDay_ns);
}

TEST_F(RetentionClockTest, KnowsTheNewestRowOfAStore) {
  const TownStore town;
  PackageStore& store = town.open();
  const std::int64_t published = newest_time_ns(store);
  EXPECT_EQ(published, store.state().version("town", "v1").created_ns);
  store.drives().open("town", "monday", published + 1);
  EXPECT_EQ(newest_time_ns(store), published + 1);
  store.jobs().enqueue({.map = "town", .request = "{}"}, published + 2);
  EXPECT_EQ(newest_time_ns(store), published + 2);
  store.audit().append({.time_ns = published + 3});
  EXPECT_EQ(newest_time_ns(store), published + 3);
}

}  // namespace retention_clock_test
}  // namespace stillmap::server
