#include "drives/value_step.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <vector>

namespace stillmap::maps {
namespace {

/// Easting of a car that turns, at any sample.
double easting_m(std::size_t i) {
  const auto t = static_cast<double>(i);
  return 5'455'123.71 + 0.83 * t + 4.1 * std::sin(0.21 * t);
}

template <typename Round>
std::vector<double> rounded(std::size_t count, const Round& round) {
  std::vector<double> values;
  for (std::size_t i = 0; i < count; ++i) values.push_back(round(easting_m(i)));
  return values;
}

TEST(ValueStep, IsFoundInNumbersWithTooFewDigits) {
  for (const double step : {0.1, 0.5, 1.0, 10.0})
    EXPECT_NEAR(
        step_of(rounded(200, [&](double value) { return step * std::round(value / step); })), step,
        1e-4 * step);
  EXPECT_NEAR(step_of(rounded(200, [](double value) { return double(float(value)); })), 0.5, 1e-9);
}

TEST(ValueStep, IsFoundInFloatsThatArePrintedWithFewDigits) {
  EXPECT_NEAR(step_of(rounded(200,
                              [](double value) {
                                const double as_float = double(float(value / 10.0));
                                return std::round(1e3 * as_float) / 1e3;
                              })),
              0.0625, 0.001);
}

TEST(ValueStep, IsFoundInFewValuesByTheirDigits) {
  EXPECT_EQ(step_of(rounded(30, [](double value) { return 10.0 * std::round(value / 10.0); })),
            10.0);
  const std::vector<double> two{7.25, 7.25, 7.25, 8.5, 8.5};
  EXPECT_EQ(step_of(two), 0.0);
}

TEST(ValueStep, IsSmallOrNoneInNumbersWithAllDigits) {
  EXPECT_EQ(step_of(rounded(200, [](double value) { return value; })), 0.0);
  EXPECT_NEAR(step_of(rounded(200, [](double value) { return std::round(1e3 * value) / 1e3; })),
              0.001, 1e-6);
}

TEST(ValueStep, EvenMotionAndStandingTellNone) {
  std::vector<double> even, standing(100, 7.0);
  for (int i = 0; i < 100; ++i) even.push_back(1.5 * i);
  EXPECT_EQ(step_of(even), 0.0);
  EXPECT_EQ(step_of(standing), 0.0);
  EXPECT_EQ(step_of({}), 0.0);
}

}  // namespace
}  // namespace stillmap::maps
