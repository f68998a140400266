#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "formats/point_times.hpp"

namespace stillmap::maps {
namespace point_times_test {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::int64_t kStampNs = 1'700'000'000'250'000'000;
constexpr std::size_t kPoints = 2000;

/// A sweep of 0.1 s in some unit, from some zero.
std::vector<double> sweep(double unit_s, double zero_s = 0.0, double span_s = 0.1) {
  std::vector<double> values;
  for (std::size_t i = 0; i < kPoints; ++i)
    values.push_back((zero_s + span_s * static_cast<double>(i) / (kPoints - 1)) / unit_s);
  return values;
}

PointTimes read(const std::vector<double>& values, NumberType type,
                std::optional<std::int64_t> stamp_ns = kStampNs) {
  return read_point_times(values, {"t", type, 1}, stamp_ns);
}

void expect_from(float first_s, float last_s, const PointTimes& times) {
  ASSERT_EQ(times.offsets_s.size(), kPoints) << times.note;
  EXPECT_NEAR(times.offsets_s.front(), first_s, 2e-6);
  EXPECT_NEAR(times.offsets_s.back(), last_s, 2e-6);
}

TEST(PointTimes, ArePlainInSecondsAndNanoseconds) {
  const PointTimes seconds = read(sweep(1.0, -0.05), NumberType::kF32);
  expect_from(-0.05F, 0.05F, seconds);
  EXPECT_THAT(seconds.note, IsEmpty());
  const PointTimes nanoseconds = read(sweep(1e-9), NumberType::kU32);
  expect_from(0.0F, 0.1F, nanoseconds);
  EXPECT_THAT(nanoseconds.note, IsEmpty());
}

TEST(PointTimes, AreTakenInTheUnitInWhichASweepTakesAsLongAsSensorsNeed) {
  const PointTimes whole = read(sweep(1e-6), NumberType::kU32);
  expect_from(0.0F, 0.1F, whole);
  EXPECT_THAT(whole.note,
              HasSubstr("'t' are taken as microseconds, since a sweep then takes 0.100 s"));
  for (const double unit_s : {1e-3, 1e-6, 1e-9}) {
    const PointTimes floating = read(sweep(unit_s), NumberType::kF32);
    expect_from(0.0F, 0.1F, floating);
    EXPECT_THAT(floating.note, HasSubstr("are taken as"));
  }
  // A few columns of a sweep in nanoseconds.
  EXPECT_THAT(read({0, 48'000, 96'000}, NumberType::kU32).note, IsEmpty());
  // All at one instant, as after deskewing.
  EXPECT_THAT(read(std::vector<double>(kPoints, 0.0), NumberType::kU32).note, IsEmpty());
}

TEST(PointTimes, CountFromTheEpochInEveryUnit) {
  for (const double unit_s : {1.0, 1e-3, 1e-6}) {
    const PointTimes times = read(sweep(unit_s, 1'700'000'000.2), NumberType::kF64);
    expect_from(-0.05F, 0.05F, times);
    EXPECT_THAT(times.note, IsEmpty());
  }
  const PointTimes nanoseconds = read(sweep(1e-9, 1'700'000'000.2), NumberType::kU64);
  expect_from(-0.05F, 0.05F, nanoseconds);
}

TEST(PointTimes, OfAnotherClockBeginAtTheStamp) {
  // The stamp is not known, or of another clock: the lidar's since it was switched on.
  for (const auto stamp_ns :
       {std::optional<std::int64_t>(), std::optional<std::int64_t>(kStampNs)}) {
    const PointTimes times = read(sweep(1.0, 543.2), NumberType::kF64, stamp_ns);
    expect_from(0.0F, 0.1F, times);
    EXPECT_THAT(times.note, HasSubstr("each scan's first time is taken for its stamp's"));
  }
}

TEST(PointTimes, AreLeftOutWhereNothingFits) {
  const auto expect_left_out = [](const PointTimes& times, const char* why) {
    EXPECT_THAT(times.offsets_s, IsEmpty());
    EXPECT_THAT(times.note, HasSubstr("'t' are left out: "));
    EXPECT_THAT(times.note, HasSubstr(why));
  };
  // Many sweeps in one cloud.
  expect_left_out(read(sweep(1.0, 0.0, 7.0), NumberType::kF64), "they span 7");
  // Floats of 32 bits have steps of 4 ms after a day.
  expect_left_out(read(sweep(1.0, 86'400.0), NumberType::kF32), "steps of 0.0078 s at 86400.1");
  // Those of today's seconds have steps of 128 s: all are one number, which may lie near the stamp.
  constexpr std::int64_t kNearAStepNs = 1'699'999'872'300'000'000;
  expect_left_out(
      read(std::vector<double>(kPoints, 1'699'999'872.0F), NumberType::kF32, kNearAStepNs),
      "they span 0, which is no sweep's time");
  std::vector<double> broken = sweep(1.0);
  broken[7] = std::numeric_limits<double>::quiet_NaN();
  expect_left_out(read(broken, NumberType::kF64), "some are not finite");
  EXPECT_THAT(read({}, NumberType::kF64).note, IsEmpty());
}

}  // namespace point_times_test
}  // namespace stillmap::maps
