#include "odometry/scan_period.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include <support/throws.hpp>

namespace stillmap::mapping {
namespace scan_period_test {

constexpr std::int64_t kMs = 1'000'000;

/// After enough regular scans to know how far they are apart.
ScanPeriod known_period(std::int64_t step_ns, std::int64_t& stamp_ns) {
  ScanPeriod period;
  for (int i = 0; i < 40; ++i) (void)period.step_to(stamp_ns += step_ns, "scan");
  return period;
}

TEST(ScanPeriod, RegularStepsAreTakenAsTheyAre) {
  ScanPeriod period;
  EXPECT_FALSE(period.step_to(0, "scan"));
  for (int i = 1; i < 5; ++i) {
    const auto step = period.step_to(100 * kMs * i, "scan");
    ASSERT_TRUE(step);
    EXPECT_DOUBLE_EQ(step->seconds, 0.1);
    EXPECT_FALSE(step->is_gap);
  }
}

TEST(ScanPeriod, ABurstOfStampsIsNoFastSensor) {
  std::int64_t stamp_ns = 0;
  ScanPeriod period = known_period(50 * kMs, stamp_ns);
  EXPECT_NEAR(period.usual_s(), 0.05, 1e-3);
  EXPECT_NEAR(period.step_to(stamp_ns + 1, "scan")->seconds, 0.025, 1e-3);
  EXPECT_NEAR(period.step_to(stamp_ns + 100 * kMs, "scan")->seconds, 0.1, 1e-9);
}

TEST(ScanPeriod, LearnsAFasterSensor) {
  std::int64_t stamp_ns = 0;
  ScanPeriod period = known_period(10 * kMs, stamp_ns);
  EXPECT_DOUBLE_EQ(period.step_to(stamp_ns + 10 * kMs, "scan")->seconds, 0.01);
}

TEST(ScanPeriod, AGapIsToldAndDoesNotChangeWhatIsUsual) {
  std::int64_t stamp_ns = 0;
  ScanPeriod period = known_period(100 * kMs, stamp_ns);
  EXPECT_FALSE(period.step_to(stamp_ns += 2900 * kMs, "scan")->is_gap);
  EXPECT_TRUE(period.step_to(stamp_ns += 3'600'000 * kMs, "scan")->is_gap);
  EXPECT_LT(period.usual_s(), 0.14);
}

TEST(ScanPeriod, RefusesStampsThatDoNotIncrease) {
  ScanPeriod period;
  (void)period.step_to(1000, "scan");
  EXPECT_THAT([&] { (void)period.step_to(1000, "late.pcd"); },
              test::ThrowsSaying<std::invalid_argument>({"late.pcd", "found stamp 1000 ns"}));
  EXPECT_TRUE(period.step_to(std::numeric_limits<std::int64_t>::max(), "scan")->is_gap);
}

}  // namespace scan_period_test
}  // namespace stillmap::mapping
