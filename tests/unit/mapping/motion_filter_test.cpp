#include "fusion/motion_filter.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "support/matchers.hpp"

namespace stillmap::mapping {
namespace motion_filter_test {

using test::IsNearVector;

constexpr MotionNoise kNoise{4.0, 8.0};

PathStep step(double time_s, double x, double y) { return {time_s, Eigen::Vector2d(x, y), 0.3}; }

TEST(MotionFilter, PredictsAlongTheVelocity) {
  MotionState state = started_at({1.0, 2.0}, 0.5, kNoise);
  state.velocity_mps = {3.0, -1.0};
  const MotionState next = predicted(state, 0.5, kNoise);
  EXPECT_THAT(next.position, IsNearVector(Eigen::Vector2d(2.5, 1.5), 1e-12));
  // 0.25 + 0.25 * 64 + 4 * 0.125 / 3, by hand.
  EXPECT_NEAR(next.covariance(0, 0), 0.25 + 16.0 + 0.5 / 3.0, 1e-12);
  EXPECT_NEAR(next.covariance(0, 1), 32.0 + 0.5, 1e-12);
  EXPECT_NEAR(next.covariance(1, 1), 66.0, 1e-12);
}

TEST(MotionFilter, WeighsAMeasurementByBothUncertainties) {
  const MotionState state = started_at({0.0, 0.0}, 1.0, kNoise);
  const MotionState next = updated(state, {2.0, -4.0}, 1.0);
  EXPECT_THAT(next.position, IsNearVector(Eigen::Vector2d(1.0, -2.0), 1e-12));
  EXPECT_NEAR(next.covariance(0, 0), 0.5, 1e-12);
}

TEST(MotionFilter, SmoothsAStraightLineExactly) {
  std::vector<PathStep> steps;
  for (int i = 0; i < 30; ++i) steps.push_back(step(0.1 * i, 5.0 + 0.9 * i, 2.0 - 0.2 * i));
  // Measurements missing in the middle and at both ends.
  for (const std::size_t i : {0U, 1U, 10U, 11U, 12U, 28U, 29U}) steps[i].position.reset();
  const auto path = smoothed_path(steps, kNoise);
  ASSERT_EQ(path.size(), 30U);
  for (int i = 0; i < 30; ++i) {
    const MotionState& state = path[static_cast<std::size_t>(i)];
    // The first speed is taken for near zero, with 8 m/s of deviation: all but forgotten.
    EXPECT_THAT(state.position, IsNearVector(Eigen::Vector2d(5.0 + 0.9 * i, 2.0 - 0.2 * i), 0.03));
    EXPECT_THAT(state.velocity_mps, IsNearVector(Eigen::Vector2d(9.0, -2.0), 0.1));
  }
}

TEST(MotionFilter, SmoothingIsTheSameBackwards) {
  std::vector<PathStep> steps, backwards;
  for (int i = 0; i < 12; ++i) steps.push_back(step(0.1 * i, std::sin(0.4 * i), 0.1 * i * i));
  for (int i = 11; i >= 0; --i) {
    backwards.push_back(steps[static_cast<std::size_t>(i)]);
    backwards.back().time_s = 1.1 - backwards.back().time_s;
  }
  const auto path = smoothed_path(steps, kNoise);
  const auto reversed = smoothed_path(backwards, kNoise);
  for (std::size_t i = 0; i < 12; ++i)
    EXPECT_THAT(path[i].position, IsNearVector(reversed[11 - i].position, 0.02));
}

TEST(MotionFilter, KnowsLessBetweenMeasurements) {
  std::vector<PathStep> steps;
  for (int i = 0; i < 20; ++i) steps.push_back(step(0.1 * i, 1.0 * i, 0.0));
  for (std::size_t i = 5; i < 15; ++i) steps[i].position.reset();
  const auto path = smoothed_path(steps, kNoise);
  EXPECT_GT(path[9].covariance(0, 0), 2.0 * path[4].covariance(0, 0));
}

TEST(MotionFilter, NeedsAMeasurement) {
  EXPECT_THROW(static_cast<void>(smoothed_path({PathStep{}}, kNoise)), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(smoothed_path({}, kNoise)), std::invalid_argument);
}

}  // namespace motion_filter_test
}  // namespace stillmap::mapping
