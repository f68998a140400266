#include "ground/step_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace step_fit_test {

using Height = std::function<double(const Eigen::Vector2d& p)>;

/// Samples every 0.25 m over 10 x 6 m around a hole of 4.5 x 1.8 m at the origin.
std::vector<HeightSample> samples_of(const Height& height, double noise_m = 0.0) {
  test::Random random(5);
  std::vector<HeightSample> samples;
  for (double y = -2.875; y < 3.0; y += 0.25) {
    for (double x = -4.875; x < 5.0; x += 0.25) {
      const Eigen::Vector2d p(x, y);
      if (std::abs(x) < 2.25 && std::abs(y) < 0.9) continue;
      samples.push_back({p, height(p) + noise_m * random.normal(), 1.0});
    }
  }
  return samples;
}

const StepBounds kBounds = {.half_m = {2.5, 1.15}, .slope = {0.0, 0.0}};

double plane_at(const Eigen::Vector2d& p) { return 1.0 + 0.08 * p.x() - 0.02 * p.y(); }

TEST(StepFit, FindsOnePlaneWithoutAStep) {
  const auto samples = samples_of(plane_at, 0.01);
  const auto fit = fit_stepped_plane(samples, {.half_m = {2.5, 1.15}, .slope = {0.08, -0.02}});
  ASSERT_TRUE(fit);
  EXPECT_FALSE(fit->has_step);
  EXPECT_NEAR(fit->z_at({1.0, 0.5}), plane_at({1.0, 0.5}), 0.003);
}

TEST(StepFit, FindsAKerbAlongAndItsTwoPlanes) {
  for (const double kerb_y : {-0.5, 0.0, 0.75}) {
    const Height kerb = [&](const Eigen::Vector2d& p) {
      return plane_at(p) + (p.y() > kerb_y ? 0.12 + 0.03 * (p.y() - kerb_y) : 0.0);
    };
    const auto fit = fit_stepped_plane(samples_of(kerb, 0.005), kBounds);
    ASSERT_TRUE(fit);
    ASSERT_TRUE(fit->has_step);
    EXPECT_NEAR(std::abs(fit->normal.y()), 1.0, 1e-9);
    EXPECT_NEAR(fit->offset * fit->normal.y(), kerb_y, 0.13);
    EXPECT_NEAR(fit->z_at({0.0, kerb_y + 0.3}), kerb({0.0, kerb_y + 0.3}), 0.01);
    EXPECT_NEAR(fit->z_at({0.0, kerb_y - 0.3}), kerb({0.0, kerb_y - 0.3}), 0.01);
  }
}

TEST(StepFit, FindsAKerbAcrossTheObject) {
  const Height kerb = [](const Eigen::Vector2d& p) { return p.x() > 1.0 ? 0.14 : 0.0; };
  const auto fit = fit_stepped_plane(samples_of(kerb), kBounds);
  ASSERT_TRUE(fit && fit->has_step);
  EXPECT_NEAR(std::abs(fit->normal.x()), 1.0, 1e-9);
  EXPECT_NEAR(fit->z_at({1.3, 0.0}), 0.14, 0.01);
  EXPECT_NEAR(fit->z_at({0.7, 0.0}), 0.0, 0.01);
}

TEST(StepFit, FindsAKerbThatIsTurned) {
  // Ten degrees against the object.
  const auto beyond = [](const Eigen::Vector2d& p) {
    return std::cos(0.1745) * p.y() - std::sin(0.1745) * p.x();
  };
  const Height kerb = [&](const Eigen::Vector2d& p) { return beyond(p) > 0.0 ? 0.12 : 0.0; };
  const auto fit = fit_stepped_plane(samples_of(kerb), kBounds);
  ASSERT_TRUE(fit && fit->has_step);
  for (const double x : {-2.0, 0.0, 2.0}) {
    for (const double y : {-0.9, -0.6, 0.6, 0.9}) {
      if (std::abs(beyond({x, y})) < 0.2) continue;
      EXPECT_NEAR(fit->z_at({x, y}), kerb({x, y}), 0.015) << x << ' ' << y;
    }
  }
}

TEST(StepFit, TakesAWallForNoKerbNorRoughnessForAStep) {
  const auto wall = fit_stepped_plane(
      samples_of([](const Eigen::Vector2d& p) { return p.y() > 0.5 ? 1.5 : 0.0; }), kBounds);
  ASSERT_TRUE(wall);
  EXPECT_FALSE(wall->has_step);
  const auto rough = fit_stepped_plane(samples_of(plane_at, 0.03), kBounds);
  ASSERT_TRUE(rough);
  EXPECT_FALSE(rough->has_step);
}

TEST(StepFit, IsNotLedAstrayByAFewWrongSamples) {
  auto samples = samples_of(plane_at);
  for (std::size_t k = 0; k < samples.size(); k += 12) samples[k].z += 0.3;
  const auto fit = fit_stepped_plane(samples, {.half_m = {2.5, 1.15}, .slope = {0.08, -0.02}});
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->z_at({0.0, 0.0}), plane_at({0.0, 0.0}), 0.01);
}

TEST(StepFit, NeedsADozenSamples) {
  auto samples = samples_of(plane_at);
  samples.resize(11);
  EXPECT_FALSE(fit_stepped_plane(samples, kBounds));
  EXPECT_FALSE(fit_stepped_plane({}, kBounds));
}

}  // namespace step_fit_test
}  // namespace stillmap::mapping
