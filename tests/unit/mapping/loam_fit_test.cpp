#include "odometry/loam/feature_map.hpp"
#include "odometry/loam/motion_fit.hpp"
#include "odometry/loam/surfaces.hpp"
#include "odometry/loam/sweep_motion.hpp"

#include "support/synthetic_world.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace stillmap::mapping::loam {
namespace loam_fit_test {

using Vector3 = Eigen::Vector3d;

Vector3 random_point(test::Random& random, double size_m) {
  return {random.uniform(-size_m, size_m), random.uniform(-size_m, size_m),
          random.uniform(-size_m, size_m)};
}

TEST(LoamSurfaces, DistanceToALineIsEquationTwo) {
  // Line along z through (1, 0): by hand, the point (4, 4, 7) is 5 m from it.
  const auto line = line_through({1.0, 0.0, 0.0}, {1.0, 0.0, 2.0});
  ASSERT_TRUE(line);
  EXPECT_NEAR(line->distance({4.0, 4.0, 7.0}), 5.0, 1e-12);
  test::Random random(1);
  for (int k = 0; k < 20; ++k) {
    const Vector3 j = random_point(random, 5.0), l = random_point(random, 5.0);
    const Vector3 X = random_point(random, 5.0);
    EXPECT_NEAR(line_through(j, l)->distance(X), (X - j).cross(X - l).norm() / (j - l).norm(),
                1e-9);
  }
}

TEST(LoamSurfaces, DistanceToAPlaneIsEquationThree) {
  const auto plane = plane_through({0.0, 0.0, 2.0}, {1.0, 0.0, 2.0}, {0.0, 1.0, 2.0});
  ASSERT_TRUE(plane);
  EXPECT_NEAR(plane->distance({8.0, -3.0, 5.0}), 3.0, 1e-12);
  test::Random random(2);
  for (int k = 0; k < 20; ++k) {
    const Vector3 j = random_point(random, 5.0), l = random_point(random, 5.0);
    const Vector3 m = random_point(random, 5.0), X = random_point(random, 5.0);
    const Vector3 n = (j - l).cross(j - m);
    EXPECT_NEAR(plane_through(j, l, m)->distance(X), std::abs((X - j).dot(n)) / n.norm(), 1e-9);
  }
}

TEST(LoamSurfaces, OfPointsThatSpanNothingAreNone) {
  EXPECT_FALSE(line_through({1.0, 1.0, 1.0}, {1.0, 1.0, 1.0}));
  EXPECT_FALSE(plane_through({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {2.0, 0.0, 0.0}));
  const double nan = std::nan("");
  EXPECT_FALSE(line_through({nan, 0.0, 0.0}, {1.0, 0.0, 0.0}));
  EXPECT_FALSE(plane_through({nan, 0.0, 0.0}, {1.0, 0.0, 0.0}, {0.0, 2.0, 0.0}));
}

TEST(LoamSurfaces, OfNeighboursAreToldByTheirEigenvalues) {
  std::vector<Eigen::Vector3f> upright, flat;
  for (int k = 0; k < 5; ++k) {
    upright.emplace_back(0.01F * static_cast<float>(k % 2), 0.0F, 0.3F * static_cast<float>(k));
  }
  flat = {{0.0F, 0.0F, 0.0F},
          {0.4F, 0.0F, 0.0F},
          {0.0F, 0.4F, 0.0F},
          {0.4F, 0.4F, 0.0F},
          {0.2F, 0.2F, 0.01F}};
  const Vector3 centre(1000.0, 2000.0, 3.0);
  const auto line = line_of(upright, centre);
  ASSERT_TRUE(line);
  EXPECT_NEAR(line->distance(centre + Vector3(0.0, 2.0, 9.0)), 2.0, 0.05);
  EXPECT_FALSE(plane_of(upright, centre));
  const auto plane = plane_of(flat, centre);
  ASSERT_TRUE(plane);
  EXPECT_NEAR(plane->distance(centre + Vector3(0.2, 0.2, 2.0)), 2.0, 0.02);
  EXPECT_FALSE(line_of(flat, centre));
}

Vector3 to_before(const Motion& T, double share, const Vector3& X) {
  PartOfMotion part(T);
  part.go_to({share, share});
  return part * X;
}

TEST(LoamMotion, JacobianIsThatOfNumericDifferences) {
  test::Random random(3);
  for (const double share : {1.0, 0.4, 1.5, 0.0}) {
    for (int k = 0; k < 10; ++k) {
      Motion T;
      T << random_point(random, 2.0), random_point(random, k == 0 ? 1e-6 : 0.5);
      const Vector3 X = random_point(random, 30.0);
      PartOfMotion part(T);
      part.go_to({share, share});
      const auto J = part.jacobian(X);
      constexpr double kStep = 1e-6;
      for (int c = 0; c < 6; ++c) {
        const Motion step = kStep * Motion::Unit(c);
        const Vector3 numeric =
            (to_before(T + step, share, X) - to_before(T - step, share, X)) / (2.0 * kStep);
        EXPECT_LT((J.col(c) - numeric).norm(), 1e-6) << share << " " << c;
      }
    }
  }
}

TEST(LoamMotion, IsInterpolatedOverTheSweep) {
  Motion T;
  T << 1.0, 0.2, 0.0, 0.0, 0.0, 0.3;
  const Vector3 X(5.0, -2.0, 1.0);
  EXPECT_LT((to_before(T, 0.0, X) - X).norm(), 1e-12);
  EXPECT_LT((to_before(T, 1.0, X) - isometry(T) * X).norm(), 1e-12);
  EXPECT_LT((to_before(T, 0.5, X) - isometry(0.5 * T) * X).norm(), 1e-12);
  EXPECT_NEAR(share_of(0.0, 0.1), 1.0, 1e-12);
  EXPECT_NEAR(share_of(-0.05, 0.1), 0.5, 1e-12);
  EXPECT_LT((motion(isometry(T)) - T).norm(), 1e-12);
}

/// Features of a skewed sweep that lie exactly on planes and lines; `walls` false leaves along x
/// untold.
std::vector<Correspondence> exact(const Motion& T, bool walls, std::uint64_t seed) {
  test::Random random(seed);
  std::vector<Correspondence> all;
  for (int k = 0; k < 300; ++k) {
    const Vector3 at = random_point(random, 20.0);
    const int axis = walls ? k % 3 : 1 + k % 2;
    Correspondence c;
    c.share.way = c.share.turn = random.uniform(0.5, 1.5);
    if (walls && k % 10 == 0) {
      c.surface = *line_through(at, at + Vector3(0.0, 0.0, 1.0));
    } else {
      const Vector3 u = Vector3::Unit((axis + 1) % 3), v = Vector3::Unit((axis + 2) % 3);
      c.surface = *plane_through(at, at + u, at + v);
    }
    c.X = rotation(c.share.turn * T.tail<3>()).transpose() * (at - c.share.way * T.head<3>());
    all.push_back(c);
  }
  return all;
}

TEST(LoamFit, FindsTheMotionOfASkewedSweepWithOutliers) {
  Motion T;
  T << 1.2, -0.1, 0.05, 0.01, -0.02, 0.06;
  auto all = exact(T, true, 4);
  for (std::size_t k = 0; k < all.size(); k += 5) all[k].X += Vector3(1.0, -2.0, 1.5);
  Motion found = Motion::Zero();
  for (const double reach_m : {3.0, 1.0, 0.3, 0.3}) {
    found = fit_motion(all, found, told_by(all, found), reach_m).T;
  }
  EXPECT_LT((found - T).head<3>().norm(), 1e-6);
  EXPECT_LT((found - T).tail<3>().norm(), 1e-7);
}

TEST(LoamFit, KeepsThePredictionWhereNothingTells) {
  Motion T;
  T << 1.0, 0.1, 0.0, 0.0, 0.0, 0.0;
  Motion predicted;
  predicted << 0.7, 0.0, 0.05, 0.0, 0.0, 0.0;
  const auto all = exact(T, false, 5);
  const Told told = told_by(all, predicted);
  ASSERT_EQ(told.untold.size(), 1U);
  EXPECT_GT(std::abs(told.untold[0][0]), 0.99);
  const MotionFit fit = fit_motion(all, predicted, told, 1.0);
  EXPECT_NEAR(fit.T[0], 0.7, 2e-3);
  EXPECT_NEAR(fit.T[1], 0.1, 1e-3);
  EXPECT_NEAR(fit.T[2], 0.0, 1e-3);
}

TEST(LoamFit, OfNothingMovesNothing) {
  const Motion T = Motion::Constant(0.1);
  EXPECT_EQ(fit_motion({}, T, Told{}, 1.0).T, T);
  EXPECT_EQ(told_by({}, T).untold.size(), 6U);
}

TEST(LoamFeatureMap, GivesTheFiveNearestOfAllWithinHalfACell) {
  FeatureMap map(2.0, 0.01);
  test::Random random(6);
  std::vector<Vector3> points;
  // Far from the frame's origin, where a float is coarser than the voxels.
  const Vector3 far(50'000.0, -30'000.0, 100.0);
  for (int k = 0; k < 400; ++k) points.push_back(far + random_point(random, 3.0));
  for (const Vector3& p : points) map.add(p);
  for (int k = 0; k < 50; ++k) {
    const Vector3 q = far + random_point(random, 3.0);
    std::vector<double> expected;
    for (const Vector3& p : points) {
      if ((p - q).norm() < 1.0) expected.push_back((p - q).norm());
    }
    std::sort(expected.begin(), expected.end());
    const auto near = map.nearest(q);
    ASSERT_EQ(near.count, std::min<std::size_t>(5, expected.size()));
    for (std::size_t i = 0; i < near.count; ++i) {
      EXPECT_NEAR(near.points[i].norm(), expected[i], 1e-5);
    }
  }
}

TEST(LoamFeatureMap, KeepsAMeanAVoxelAndForgetsWhatIsFar) {
  FeatureMap map(2.0, 0.4);
  map.add({0.1, 0.1, 0.1});
  map.add({0.3, 0.1, 0.1});
  map.add({50.0, 0.0, 0.0});
  EXPECT_EQ(map.size(), 2U);
  EXPECT_NEAR(map.nearest({0.2, 0.1, 0.1}).points[0].norm(), 0.0, 1e-6);
  map.keep_around({0.0, 0.0, 0.0}, 20.0);
  EXPECT_EQ(map.size(), 1U);
  EXPECT_EQ(map.nearest({50.0, 0.0, 0.0}).count, 0U);
  EXPECT_EQ(map.nearest({0.2, 0.1, 0.1}).count, 1U);
}

}  // namespace loam_fit_test
}  // namespace stillmap::mapping::loam
