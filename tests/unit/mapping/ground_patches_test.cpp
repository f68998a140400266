#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "ground/concentric_zones.hpp"
#include "ground/ground_likelihood.hpp"
#include "ground/plane_fit.hpp"
#include "ground/reflected_noise.hpp"
#include "ground/region_fit.hpp"
#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace ground_patches_test {

using testing::ElementsAre;

constexpr double kAnyDepth = std::numeric_limits<double>::infinity();

// The zones' bounds for 2.7 and 80 m: 2.7, 12.3625, 22.025, 41.35, 80.

TEST(ConcentricZones, HaveTheBoundsOfThePaper) {
  EXPECT_THAT(ConcentricZones::kBoundsM,
              ElementsAre(2.7, testing::DoubleEq(12.3625), testing::DoubleEq(22.025),
                          testing::DoubleEq(41.35), 80.0));
}

TEST(ConcentricZones, NumberPatchesRingByRingAndCounterClockwise) {
  EXPECT_EQ(ConcentricZones::patch_of(3.0, 0.01), 0);
  EXPECT_EQ(ConcentricZones::patch_of(3.0, -0.01), 15);
  EXPECT_EQ(ConcentricZones::patch_of(0.01, 3.0), 3);   // just before a quarter turn of 16
  EXPECT_EQ(ConcentricZones::patch_of(-0.01, 3.0), 4);  // just after it
  EXPECT_EQ(ConcentricZones::patch_of(8.0, 0.01), 16);  // the second ring begins at 7.53 m
  EXPECT_EQ(ConcentricZones::patch_of(12.4, 0.01), 32);
  EXPECT_EQ(ConcentricZones::patch_of(22.1, 0.01), 32 + 4 * 32);
  EXPECT_EQ(ConcentricZones::patch_of(41.4, 0.01), 32 + 4 * 32 + 4 * 54);
  EXPECT_EQ(ConcentricZones::patch_of(79.9, -0.01), ConcentricZones::kPatchCount - 1);
}

TEST(ConcentricZones, EndAtTheirBoundsAndHoldNoNaN) {
  EXPECT_EQ(ConcentricZones::patch_of(2.69, 0.0), -1);
  EXPECT_EQ(ConcentricZones::patch_of(2.7, 0.0), 0);
  EXPECT_EQ(ConcentricZones::patch_of(80.0, 0.0), -1);
  EXPECT_EQ(ConcentricZones::patch_of(std::nan(""), 5.0), -1);
}

TEST(ConcentricZones, CountRingsThroughAllZones) {
  EXPECT_EQ(ConcentricZones::ring_of(0), 0);
  EXPECT_EQ(ConcentricZones::ring_of(31), 1);
  EXPECT_EQ(ConcentricZones::ring_of(32), 2);
  EXPECT_EQ(ConcentricZones::ring_of(ConcentricZones::kPatchCount - 1),
            ConcentricZones::kRingCount - 1);
}

TEST(PlaneFit, FindsMeanNormalAndVariancesByHand) {
  PlaneSums sums;
  for (const double x : {-2.0, 2.0}) {
    for (const double y : {-1.0, 1.0}) {
      for (const double z : {-0.1, 0.1}) sums.add(10.0 + x, y, 5.0 + z);
    }
  }
  const PlaneFit plane = sums.fit();
  EXPECT_EQ(plane.points, 8);
  EXPECT_NEAR((plane.mean - Eigen::Vector3d(10.0, 0.0, 5.0)).norm(), 0.0, 1e-12);
  EXPECT_NEAR(plane.uprightness(), 1.0, 1e-12);
  EXPECT_NEAR(plane.variances[0], 4.0, 1e-9);
  EXPECT_NEAR(plane.variances[1], 1.0, 1e-9);
  EXPECT_NEAR(plane.flatness, 0.01, 1e-9);
  EXPECT_NEAR(plane.line_ratio(), 4.0, 1e-9);
}

TEST(PlaneFit, KnowsTheHeightOfASlope) {
  PlaneSums sums;
  for (int i = 0; i < 100; ++i) {
    const double x = 20.0 + i % 10, y = -5.0 + i / 10;
    sums.add(x, y, 0.3 + 0.1 * x - 0.05 * y);
  }
  const PlaneFit plane = sums.fit();
  EXPECT_NEAR(plane.height_at(40.0, 10.0), 0.3 + 4.0 - 0.5, 1e-9);
  EXPECT_NEAR(plane.flatness, 0.0, 1e-9);
}

TEST(PlaneFit, TurnsAPlaneThroughALineToBeLevelAcrossIt) {
  PlaneSums sums;
  for (int i = 0; i < 50; ++i) sums.add(15.0 + 0.001 * (i % 3), 0.1 * i, 0.01 * i);
  const PlaneFit plane = sums.fit();
  EXPECT_NEAR(plane.normal.x(), 0.0, 0.01);
  EXPECT_NEAR(-plane.normal.y() / plane.normal.z(), 0.1, 1e-3);
}

std::vector<CellPoint> patch_of_ground(double height_m = 0.0) {
  std::vector<CellPoint> points;
  test::Random random(4);
  for (int i = 0; i < 400; ++i) {
    const auto x = static_cast<float>(6.0 + 0.1 * (i % 20));
    const auto y = static_cast<float>(0.1 * (i / 20));
    points.push_back({x, y, static_cast<float>(height_m + 0.01 * random.normal()), 0});
  }
  return points;
}

TEST(RegionFit, FindsTheGroundUnderABox) {
  std::vector<CellPoint> points = patch_of_ground();
  for (int i = 0; i < 200; ++i)
    points.push_back(
        {7.0F, 0.01F * static_cast<float>(i), 0.3F + 0.005F * static_cast<float>(i), 0});
  std::vector<CellPoint> scratch;
  const auto region = fit_region(points, kAnyDepth, scratch);
  ASSERT_TRUE(region);
  EXPECT_NEAR(region->plane.mean.z(), 0.0, 0.01);
  EXPECT_GT(region->plane.uprightness(), 0.999);
  EXPECT_EQ(region->vertical_points, 0);
}

TEST(RegionFit, SetsAWallThatReachesBelowTheGroundAside) {
  // A terrace: the ground above a retaining wall whose foot is 3 m lower.
  std::vector<CellPoint> points = patch_of_ground();
  test::Random random(9);
  for (int i = 0; i < 600; ++i) {
    const auto z = static_cast<float>(-3.0 + 3.0 * random.uniform());
    points.push_back({5.95F, static_cast<float>(2.0 * random.uniform()), z, 0});
  }
  std::vector<CellPoint> scratch;
  const auto region = fit_region(points, kAnyDepth, scratch);
  ASSERT_TRUE(region);
  EXPECT_GT(region->vertical_points, 500);
  EXPECT_NEAR(region->plane.mean.z(), 0.0, 0.02);
  EXPECT_GT(region->plane.uprightness(), 0.99);
}

TEST(RegionFit, SeedsNothingFromReflectionsInTheInnermostZone) {
  std::vector<CellPoint> points = patch_of_ground();
  for (int i = 0; i < 40; ++i) points.push_back({6.5F, 0.02F * static_cast<float>(i), -2.0F, 0});
  std::vector<CellPoint> scratch;
  const auto region = fit_region(points, 0.35, scratch);
  ASSERT_TRUE(region);
  EXPECT_NEAR(region->plane.mean.z(), 0.0, 0.01);
}

TEST(RegionFit, NeedsTenPoints) {
  std::vector<CellPoint> points = patch_of_ground();
  std::vector<CellPoint> scratch;
  points.resize(9);
  EXPECT_FALSE(fit_region(points, kAnyDepth, scratch));
  EXPECT_FALSE(fit_region({}, kAnyDepth, scratch));
}

// Ground likelihood.

LikelihoodInput patch(int ring, double elevation_m, double flatness_m2, double tilt_rad = 0.0) {
  LikelihoodInput input;
  input.ring = ring;
  input.plane.mean = Eigen::Vector3d(5.0, 0.0, elevation_m);
  input.plane.normal = Eigen::Vector3d(std::sin(tilt_rad), 0.0, std::cos(tilt_rad));
  input.plane.variances = Eigen::Vector3d(1.0, 0.5, flatness_m2);
  input.plane.flatness = flatness_m2;
  input.plane.points = 100;
  return input;
}

PatchVerdict verdict(const GroundLikelihood& likelihood, const LikelihoodInput& input) {
  return likelihood.judge(std::vector{input}, 1.8).front();
}

TEST(GroundLikelihood, StartsFromPatchworksFixedThresholds) {
  const GroundLikelihood likelihood;
  EXPECT_DOUBLE_EQ(likelihood.elevation_threshold_m(0), 0.523);
  EXPECT_DOUBLE_EQ(likelihood.flatness_threshold_m2(3), 0.001);
  EXPECT_EQ(verdict(likelihood, patch(0, 0.5, 0.01)), PatchVerdict::kGround);
  EXPECT_EQ(verdict(likelihood, patch(0, 0.6, 0.01)), PatchVerdict::kRefused);
  EXPECT_EQ(verdict(likelihood, patch(0, 0.6, 0.0004)), PatchVerdict::kGround);
}

TEST(GroundLikelihood, RefusesWhatIsSteeperThan45Degrees) {
  const GroundLikelihood likelihood;
  EXPECT_EQ(verdict(likelihood, patch(0, 0.0, 0.0, -0.78)), PatchVerdict::kGround);
  EXPECT_EQ(verdict(likelihood, patch(0, 0.0, 0.0, -0.79)), PatchVerdict::kRefused);
  EXPECT_EQ(verdict(likelihood, patch(9, 0.0, 0.0, -0.79)), PatchVerdict::kRefused);
}

TEST(GroundLikelihood, RefusesAPlaneThatPassesAboveTheSensor) {
  // 40 degrees up over 5 m is above a sensor at 1.8 m when the plane falls toward it.
  EXPECT_EQ(verdict(GroundLikelihood(), patch(0, 0.0, 0.0, 0.7)), PatchVerdict::kRefused);
}

TEST(GroundLikelihood, AsksForUprightnessAloneFarOut) {
  EXPECT_EQ(verdict(GroundLikelihood(), patch(4, 3.0, 0.05)), PatchVerdict::kGround);
}

TEST(GroundLikelihood, LearnsMeanAndSpreadOfEachRing) {
  GroundLikelihood likelihood;
  std::vector<LikelihoodInput> seen;
  for (int i = 0; i < 20; ++i) seen.push_back(patch(1, i % 2 == 0 ? 0.0 : 0.1, i % 2 * 0.0002));
  likelihood.learn(seen);
  // Mean 0.05, deviation 0.05 sqrt(20 / 19); a_1 = 2. Mean 0.0001 with the same spread; b_1 = 1.
  const double factor = std::sqrt(20.0 / 19.0);
  EXPECT_NEAR(likelihood.elevation_threshold_m(1), 0.05 + 2.0 * 0.05 * factor, 1e-12);
  EXPECT_NEAR(likelihood.flatness_threshold_m2(1), 0.0001 + 0.0001 * factor, 1e-12);
  EXPECT_DOUBLE_EQ(likelihood.elevation_threshold_m(0), 0.523);
}

TEST(GroundLikelihood, LearnsNeitherFromHighNorFromSteepNorFromTooFewPatches) {
  GroundLikelihood likelihood;
  std::vector<LikelihoodInput> seen(100, patch(0, 0.6, 0.0));
  seen.resize(200, patch(0, 0.0, 0.0, -1.0));
  seen.resize(219, patch(0, 0.0, 0.0));
  likelihood.learn(seen);
  EXPECT_DOUBLE_EQ(likelihood.elevation_threshold_m(0), 0.523);
  likelihood.learn(std::vector{patch(0, 0.0, 0.0)});
  EXPECT_DOUBLE_EQ(likelihood.elevation_threshold_m(0), 0.0);
}

TEST(GroundLikelihood, ForgetsAllButTheLastThousand) {
  GroundLikelihood likelihood;
  likelihood.learn(std::vector(500, patch(0, 0.4, 0.0)));
  EXPECT_NEAR(likelihood.elevation_threshold_m(0), 0.4, 1e-9);
  likelihood.learn(std::vector(1000, patch(0, 0.1, 0.0)));
  EXPECT_NEAR(likelihood.elevation_threshold_m(0), 0.1, 1e-9);
}

TEST(GroundLikelihood, TakesBackWhatIsNearlyAsFlatAsItsRing) {
  // Certain ground of the ring: flatness 0.002 and 0.004, so mean 0.003, deviation 0.001 sqrt(2);
  // reverted below 0.003 + 1.5 of it, 0.00512.
  const std::vector<LikelihoodInput> patches = {patch(0, 0.0, 0.002), patch(0, 0.0, 0.004),
                                                patch(0, 0.6, 0.0051), patch(0, 0.6, 0.0052),
                                                patch(1, 0.9, 0.0051)};
  const auto verdicts = GroundLikelihood().judge(patches, 1.8);
  EXPECT_EQ(verdicts[2], PatchVerdict::kGround);
  EXPECT_EQ(verdicts[3], PatchVerdict::kRefused);
  EXPECT_EQ(verdicts[4], PatchVerdict::kRefused) << "another ring's ground";
}

TEST(GroundLikelihood, TakesNoLineBack) {
  std::vector<LikelihoodInput> patches = {patch(0, 0.0, 0.002), patch(0, 0.0, 0.004),
                                          patch(0, 0.6, 0.0051)};
  patches[2].plane.variances = Eigen::Vector3d(1.0, 0.12, 0.0051);
  EXPECT_EQ(GroundLikelihood().judge(patches, 1.8)[2], PatchVerdict::kRefused);
}

// Reflected noise.

maps::PointCloud points_below_the_road(float weak, float strong) {
  maps::PointCloud cloud;
  for (int i = 0; i < 320; ++i) {
    cloud.positions.emplace_back(4.0F, 0.01F * static_cast<float>(i), -1.8F);
    cloud.intensities.push_back(0.5F);
  }
  cloud.positions.emplace_back(4.0F, 0.0F, -2.7F);
  cloud.intensities.push_back(weak);
  cloud.positions.emplace_back(4.0F, 0.0F, -2.7F);
  cloud.intensities.push_back(strong);
  cloud.positions.emplace_back(4.0F, 0.0F, -2.5F);  // 0.7 m below: not deep enough
  cloud.intensities.push_back(weak);
  cloud.positions.emplace_back(12.0F, 0.0F, -2.7F);  // 12.7 degrees: not steep enough
  cloud.intensities.push_back(weak);
  return cloud;
}

TEST(ReflectedNoise, IsSteepDeepAndWeak) {
  const auto noise =
      find_reflected_noise(points_below_the_road(0.1F, 0.9F), SeedPlane{-1.8, {0.0, 0.0}});
  ASSERT_EQ(noise.size(), 324U);
  EXPECT_EQ(std::count(noise.begin(), noise.end(), 1), 1);
  EXPECT_EQ(noise[320], 1);
}

TEST(ReflectedNoise, IsFoundInAnyScaleOfIntensity) {
  maps::PointCloud cloud = points_below_the_road(0.1F, 0.9F);
  for (float& intensity : cloud.intensities) intensity *= 3000.0F;
  EXPECT_EQ(find_reflected_noise(cloud, SeedPlane{-1.8, {0.0, 0.0}})[320], 1);
}

TEST(ReflectedNoise, IsFoundByGeometryWithoutIntensities) {
  maps::PointCloud cloud = points_below_the_road(0.1F, 0.9F);
  cloud.intensities.clear();
  const auto noise = find_reflected_noise(cloud, SeedPlane{-1.8, {0.0, 0.0}});
  EXPECT_EQ(std::count(noise.begin(), noise.end(), 1), 2);
}

TEST(ReflectedNoise, IsNotTheStreetOfADescent) {
  maps::PointCloud cloud;
  for (float x = 3.0F; x < 12.0F; x += 0.1F) {
    cloud.positions.emplace_back(x, 0.0F, -1.8F - 0.15F * x);
    cloud.intensities.push_back(0.1F);
  }
  EXPECT_TRUE(find_reflected_noise(cloud, SeedPlane{-1.8, {-0.15, 0.0}}).empty());
}

TEST(ReflectedNoise, BearsIntensitiesThatAreNotNumbers) {
  maps::PointCloud cloud = points_below_the_road(0.1F, 0.9F);
  for (float& intensity : cloud.intensities) intensity = std::nanf("");
  EXPECT_EQ(find_reflected_noise(cloud, SeedPlane{-1.8, {0.0, 0.0}})[320], 0);
}

}  // namespace ground_patches_test
}  // namespace stillmap::mapping
