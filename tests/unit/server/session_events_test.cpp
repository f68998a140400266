#include "http/session_events.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <future>

#include <thread>

#include "pose/clock_skew.hpp"

namespace stillmap::server {
namespace session_events_test {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kAtOnce{0};

TEST(SessionEvents, AStreamThatComesBackGoesOnWhereItWas) {
  SessionEvents events;
  for (const char* data : {"1", "2", "3"}) events.add("status", data);
  const SessionEvents::Read read = events.after(1, kAtOnce);
  ASSERT_EQ(read.events.size(), 2U);
  EXPECT_EQ(read.events[0].id, 2U);
  EXPECT_EQ(read.events[1].data, "3");
  EXPECT_EQ(read.missed, 0U);
  EXPECT_TRUE(events.after(3, kAtOnce).events.empty());
}

TEST(SessionEvents, WhoWaitsIsWokenByTheNextOneAndByTheEnd) {
  SessionEvents events;
  const auto wait = [&](std::uint64_t last_id) {
    return std::async(std::launch::async,
                      [&events, last_id] { return events.after(last_id, std::chrono::hours(1)); });
  };
  auto first = wait(0);
  // It has nothing yet.
  EXPECT_EQ(first.wait_for(std::chrono::milliseconds(50)), std::future_status::timeout);
  events.add("status", "{}");
  EXPECT_EQ(first.get().events.size(), 1U);
  auto second = wait(1);
  EXPECT_EQ(second.wait_for(std::chrono::milliseconds(50)), std::future_status::timeout);
  events.close();
  EXPECT_TRUE(second.get().closed);
}

TEST(SessionEvents, OldOnesAreForgottenAndThatIsSaid) {
  SessionEvents events;
  for (std::size_t i = 0; i < SessionEvents::kKept + 10; ++i) events.add("status", "{}");
  const SessionEvents::Read read = events.after(4, kAtOnce);
  EXPECT_EQ(read.events.size(), SessionEvents::kKept);
  EXPECT_EQ(read.missed, 6U);
  EXPECT_TRUE(to_stream(read).starts_with("event: gap\ndata: {\"missed\": 6}\n\nid: 11\n"));
}

TEST(SessionEvents, ANumberThatWasNeverGivenHasSeenNothing) {
  SessionEvents events;
  events.add("status", "{}");
  EXPECT_EQ(events.after(99, kAtOnce).events.size(), 1U);
}

TEST(SessionEvents, WaitsForTheNextAndEndsWhenClosed) {
  SessionEvents events;
  std::jthread writer([&] { events.add("status", "{}"); });
  EXPECT_EQ(events.after(0, seconds(20)).events.size(), 1U);
  writer.join();
  std::jthread closer([&] { events.close(); });
  EXPECT_TRUE(events.after(1, seconds(20)).closed);
}

TEST(SessionEvents, TravelAsServerSentEvents) {
  SessionEvents events;
  events.add("status", "{\"status\":\"ok\"}");
  EXPECT_EQ(to_stream(events.after(0, kAtOnce)),
            "id: 1\nevent: status\ndata: {\"status\":\"ok\"}\n\n");
}

TEST(SessionEvents, LastEventIdsThatAreNoneCountAsNone) {
  EXPECT_EQ(last_event_id("17"), 17U);
  for (const char* text : {"", "x", "-1", "17x", "99999999999999999999999"}) {
    EXPECT_EQ(last_event_id(text), 0U) << text;
  }
}

TEST(ClockSkew, IsToldBeyondWhatIsAllowedEitherWay) {
  const std::chrono::system_clock::time_point now(seconds(1'800'000'000));
  const std::int64_t now_ns = 1'800'000'000'000'000'000;
  const auto skew = [&](double ahead_s) {
    return clock_skew_s(now_ns + static_cast<std::int64_t>(1e9 * ahead_s), now, seconds(2));
  };
  EXPECT_FALSE(skew(0.0));
  EXPECT_FALSE(skew(1.9));
  EXPECT_FALSE(skew(-1.9));
  EXPECT_NEAR(skew(5.0).value(), 5.0, 1e-6);
  EXPECT_NEAR(skew(-3600.0).value(), -3600.0, 1e-6);
}

TEST(ClockSkew, RelativeClocksAreLeftAlone) {
  const std::chrono::system_clock::time_point now(seconds(1'800'000'000));
  for (const std::int64_t stamp_ns :
       {std::int64_t{-5}, std::int64_t{0}, std::int64_t{86'400} * 1'000'000'000}) {
    EXPECT_FALSE(clock_skew_s(stamp_ns, now, seconds(2)));
  }
}

}  // namespace session_events_test
}  // namespace stillmap::server
