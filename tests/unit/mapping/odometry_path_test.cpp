#include "loops/odometry_path.hpp"

#include <gtest/gtest.h>
#include <stillmap/maps/frames.hpp>

#include <cmath>
#include <cstddef>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace odometry_path_test {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

Matrix6d step_covariance() {
  Vector6d deviations;
  deviations << 0.01, 0.02, 0.03, 1e-3, 2e-3, 3e-3;
  return deviations.cwiseAbs2().asDiagonal();
}

/// A winding path.
OdometryPath winding(std::size_t count) {
  OdometryPath path;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  Vector6d step;
  step << 1.0, 0.1, -0.02, 0.01, -0.02, 0.08;
  for (std::size_t i = 0; i < count; ++i) {
    path.append(T, step_covariance(), 0);
    T = T * maps::exp_se3(step);
  }
  return path;
}

TEST(OdometryPath, CountsTheWayWithinADrive) {
  OdometryPath path;
  for (const double x : {0.0, 3.0, 1.0}) path.append(test::pose_at(x, 0.0), step_covariance(), 0);
  for (const double x : {0.0, 2.0}) path.append(test::pose_at(x, 0.0), step_covariance(), 4);
  EXPECT_EQ(path.size(), 5U);
  EXPECT_DOUBLE_EQ(path.way_m(0, 2), 5.0);
  EXPECT_DOUBLE_EQ(path.way_m(2, 1), 2.0);
  EXPECT_DOUBLE_EQ(path.way_m(3, 4), 2.0);
  EXPECT_TRUE(std::isinf(path.way_m(2, 3)));
}

TEST(OdometryPath, SumsTheStepsOfAStretchAsACompositionDoes) {
  const OdometryPath path = winding(30);
  UncertainMotion sum;
  for (std::size_t i = 7; i < 25; ++i) {
    const Eigen::Isometry3d step = path.T_odom_lidar(i).inverse() * path.T_odom_lidar(i + 1);
    sum = composed(sum, {step, step_covariance()});
  }
  const UncertainMotion found = path.motion(7, 25);
  EXPECT_LT((found.T.matrix() - sum.T.matrix()).norm(), 1e-9);
  Matrix6d share = found.covariance - sum.covariance;
  const double way = path.way_m(7, 25);
  EXPECT_NEAR(share(0, 0), std::pow(OdometryPath::least_drift_m(way), 2), 1e-9);
  EXPECT_GT(share(5, 5), 0.0);
  share.diagonal().setZero();
  EXPECT_LT(share.norm(), 1e-9);
}

TEST(OdometryPath, DriftsSidewaysWithTheTurnsBehindIt) {
  OdometryPath path;
  Matrix6d turn_only = Matrix6d::Zero();
  turn_only(5, 5) = 1e-4;
  for (int i = 0; i <= 10; ++i) path.append(test::pose_at(i, 0.0), turn_only, 0);
  // A turn at the end of step k moves what is 10 - k metres ahead: the sum of 9^2 + ... + 0^2.
  const UncertainMotion found = path.motion(0, 10);
  const double share = std::pow(OdometryPath::least_drift_m(10.0), 2);
  EXPECT_NEAR(found.covariance(1, 1) - share, 1e-4 * 285.0, 1e-12);
  EXPECT_NEAR(found.covariance(0, 0) - share, 0.0, 1e-12);
}

TEST(OdometryPath, GoesBackAsItCame) {
  const OdometryPath path = winding(20);
  const UncertainMotion there = path.motion(3, 15);
  const UncertainMotion back = path.motion(15, 3);
  EXPECT_TRUE((there.T * back.T).matrix().isIdentity(1e-9));
  EXPECT_LT((inverted(back).covariance - there.covariance).norm(), 1e-9);
}

TEST(OdometryPath, TellsTheCovarianceOfAMetre) {
  const OdometryPath path = winding(20);
  const double step_m = path.way_m(0, 1);
  EXPECT_LT((path.covariance_per_m(4, 16) - step_covariance() / step_m).norm(), 1e-12);
  EXPECT_EQ(path.covariance_per_m(4, 4).norm(), 0.0);
}

TEST(ChiSquared, WeighsWhatLiesBetweenByBothCovariances) {
  UncertainMotion a;
  a.covariance = step_covariance();
  UncertainMotion b = a;
  EXPECT_NEAR(chi_squared(a, b), 0.0, 1e-12);
  b.T.translation().x() = 0.03;
  EXPECT_NEAR(chi_squared(a, b), 0.0009 / 0.0002, 1e-9);
  EXPECT_NEAR(chi_squared(b, a), 0.0009 / 0.0002, 1e-9);
  b.covariance = -2.0 * a.covariance;
  EXPECT_TRUE(std::isinf(chi_squared(a, b)));
}

}  // namespace odometry_path_test
}  // namespace stillmap::mapping
