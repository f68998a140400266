#include <gtest/gtest.h>
#include <stillmap/maps/frames.hpp>

#include <cmath>
#include <numbers>
#include <random>

#include "support/matchers.hpp"

namespace stillmap::maps {
namespace frames_test {

using test::IsNearPose;
using test::IsNearVector;
using Twist = Eigen::Matrix<double, 6, 1>;

Twist twist(double tx, double ty, double tz, double rx, double ry, double rz) {
  Twist v;
  v << tx, ty, tz, rx, ry, rz;
  return v;
}

/// exp by its series with the 4x4 generator: slow, and independent of the closed form.
Eigen::Isometry3d exp_by_series(const Twist& v) {
  Eigen::Matrix4d generator = Eigen::Matrix4d::Zero();
  generator.topLeftCorner<3, 3>() << 0, -v[5], v[4], v[5], 0, -v[3], -v[4], v[3], 0;
  generator.topRightCorner<3, 1>() = v.head<3>();
  Eigen::Matrix4d term = Eigen::Matrix4d::Identity();
  Eigen::Matrix4d sum = term;
  for (int i = 1; i < 60; ++i) {
    term = (term * generator / i).eval();
    sum += term;
  }
  return Eigen::Isometry3d(sum);
}

TEST(ExpSe3, OfZeroIsTheIdentity) {
  EXPECT_EQ(exp_se3(Twist::Zero()).matrix(), Eigen::Matrix4d::Identity());
}

TEST(ExpSe3, TranslatesAlongTheQuarterCircleThatTheTwistDescribes) {
  // Driving pi/2 metres ahead while turning left by 90 degrees: a circle of radius 1 around (0, 1).
  const double quarter = 0.5 * std::numbers::pi;
  const Eigen::Isometry3d T = exp_se3(twist(quarter, 0, 0, 0, 0, quarter));
  EXPECT_THAT(T.translation(), IsNearVector(Eigen::Vector3d(1, 1, 0), 1e-14));
  EXPECT_THAT(T.linear() * Eigen::Vector3d::UnitX(), IsNearVector(Eigen::Vector3d(0, 1, 0), 1e-14));
}

TEST(ExpSe3, AgreesWithTheMatrixSeriesAtEveryAngle) {
  // 0.05 rad is where the code changes from series to closed form.
  for (const double angle : {0.0, 1e-12, 1e-8, 1e-4, 0.0499, 0.0501, 0.3, 1.0, 2.0, 3.1415}) {
    const Twist v = twist(1.0, -2.0, 0.5, 0.6 * angle, 0.0, 0.8 * angle);
    EXPECT_THAT(exp_se3(v), IsNearPose(exp_by_series(v), 1e-13, 1e-13)) << angle;
  }
}

TEST(LogSe3, InvertsExpUpToHalfATurn) {
  for (const double angle : {0.0, 1e-12, 1e-8, 1e-4, 0.0499, 0.0501, 0.3, 1.0, 2.0, 3.0, 3.14159}) {
    const Twist v = twist(10.0, -20.0, 5.0, 0.48 * angle, -0.6 * angle, 0.64 * angle);
    EXPECT_THAT(log_se3(exp_se3(v)), IsNearVector(v, 1e-11)) << angle;
  }
}

TEST(LogSe3, GivesHalfATurnAroundEachAxis) {
  for (int axis = 0; axis < 3; ++axis) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() =
        Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::Unit(axis)).toRotationMatrix();
    T.translation() << 1, 2, 3;
    const Twist v = log_se3(T);
    EXPECT_NEAR(v.tail<3>().norm(), std::numbers::pi, 1e-12);
    EXPECT_THAT(exp_se3(v), IsNearPose(T, 1e-12, 1e-12));
  }
}

TEST(LogSe3, AnglesStayBelowHalfATurn) {
  const Twist v = log_se3(exp_se3(twist(0, 0, 0, 0, 0, 1.5 * std::numbers::pi)));
  EXPECT_NEAR(v[5], -0.5 * std::numbers::pi, 1e-12);
}

TEST(Renormalized, KeepsARotationAndItsTranslation) {
  const Eigen::Isometry3d T = exp_se3(twist(1, 2, 3, 0.4, -0.5, 0.6));
  EXPECT_THAT(renormalized(T), IsNearPose(T, 0.0, 1e-15));
  EXPECT_EQ(renormalized(Eigen::Isometry3d::Identity()).matrix(), Eigen::Matrix4d::Identity());
}

TEST(Renormalized, HoldsALongChainOfProductsInSo3) {
  const Eigen::Isometry3d step = exp_se3(twist(0, 0, 0, 1e-3, 2e-3, -3e-3));
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() *= 1.0 + 1e-6;
  for (int i = 0; i < 1000; ++i) T = renormalized(T * step);
  const Eigen::Matrix3d R = T.linear();
  EXPECT_LT((R.transpose() * R - Eigen::Matrix3d::Identity()).norm(), 1e-14);
  EXPECT_NEAR(R.determinant(), 1.0, 1e-14);
}

TEST(Renormalized, FindsTheNearestRotationOfANoisyOne) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> noise(-1e-3, 1e-3);
  const Eigen::Isometry3d truth = exp_se3(twist(0, 0, 0, 0.3, 0.2, -0.9));
  Eigen::Isometry3d noisy = truth;
  for (int i = 0; i < 9; ++i) noisy.matrix()(i % 3, i / 3) += noise(random);
  EXPECT_THAT(renormalized(noisy), IsNearPose(truth, 0.0, 2e-3));
}

TEST(RotationAngle, IsExactForTinyAndForHalfTurns) {
  for (const double angle : {0.0, 1e-9, 0.5, 3.0, std::numbers::pi}) {
    const Eigen::Matrix3d R =
        Eigen::AngleAxisd(angle, Eigen::Vector3d(1, 2, -2) / 3.0).toRotationMatrix();
    EXPECT_NEAR(rotation_angle_rad(R), angle, 1e-15 + 1e-12 * angle);
  }
}

TEST(RotationAngle, IsTheSameForTheInverse) {
  const Eigen::Matrix3d R = exp_se3(twist(0, 0, 0, 0.1, 0.2, 0.3)).linear();
  EXPECT_DOUBLE_EQ(rotation_angle_rad(R), rotation_angle_rad(R.transpose()));
}

TEST(IsNearPoseMatcher, FailsOnNanAndOnEitherTolerance) {
  Eigen::Isometry3d broken = Eigen::Isometry3d::Identity();
  broken.translation().x() = std::nan("");
  const Eigen::Isometry3d T = exp_se3(twist(0.1, 0, 0, 0, 0, 0.1));
  const Eigen::Isometry3d identity = Eigen::Isometry3d::Identity();
  EXPECT_THAT(broken, ::testing::Not(IsNearPose(identity, 1.0, 1.0)));
  EXPECT_THAT(T, ::testing::Not(IsNearPose(identity, 1.0, 0.09)));
  EXPECT_THAT(T, ::testing::Not(IsNearPose(identity, 0.09, 1.0)));
  EXPECT_THAT(T, IsNearPose(identity, 0.11, 0.11));
}

}  // namespace frames_test
}  // namespace stillmap::maps
