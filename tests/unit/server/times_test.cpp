#include "store/ids_and_times.hpp"

#include <gtest/gtest.h>

namespace stillmap::server {
namespace times_test {

TEST(TimeIn, ReadsTimesInUtc) {
  EXPECT_EQ(time_in("1970-01-02T00:00:01Z"), 86'401'000'000'000);
  EXPECT_EQ(time_in("2026-11-29T10:30:00Z"), 1'795'948'200'000'000'000);
  EXPECT_EQ(time_in("2026-11-29T10:30:00.25Z"), 1'795'948'200'250'000'000);
  EXPECT_EQ(time_in("2028-02-29T00:00:00.000000001Z"), 1'835'395'200'000'000'001);
  EXPECT_EQ(time_in("1795948200000000000"), 1'795'948'200'000'000'000);
}

TEST(TimeIn, RefusesWhatIsNoTime) {
  for (const char* text :
       {"", "now", "-1", "2026-11-29", "2026-11-29T10:30:00", "2026-11-29 10:30:00Z",
        "2026-11-29T10:30:00+01:00", "2026-11-29T10:30:00.Z", "2026-11-29T10:30:00.1234567890Z",
        "2026-02-30T10:30:00Z", "1969-12-31T23:59:59Z", "9999-01-01T00:00:00Z",
        "2026-11-29T10:30:00ZZ", "99999999999999999999"})
    EXPECT_EQ(time_in(text), std::nullopt) << text;
}

}  // namespace times_test
}  // namespace stillmap::server
