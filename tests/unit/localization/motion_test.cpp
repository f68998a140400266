#include "tracking/motion.hpp"

#include <stillmap/maps/frames.hpp>

#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <cmath>
#include <limits>
#include <numbers>

namespace stillmap::localization {
namespace motion_test {

using test::pose_at;

Eigen::Matrix3d cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d out;
  out << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return out;
}

/// T exp(x) = exp(adjoint(T) x) T for twists with the translation first.
Matrix6d adjoint(const Eigen::Isometry3d& T) {
  Matrix6d out = Matrix6d::Zero();
  out.topLeftCorner<3, 3>() = T.linear();
  out.bottomRightCorner<3, 3>() = T.linear();
  out.topRightCorner<3, 3>() = cross(T.translation()) * T.linear();
  return out;
}

Matrix6d some_covariance(std::uint64_t seed, double scale) {
  test::Random random(seed);
  Matrix6d root;
  for (Eigen::Index i = 0; i < root.size(); ++i) root(i) = random.normal();
  return scale * scale * (root * root.transpose() + Matrix6d::Identity());
}

Eigen::Isometry3d turned(double angle_rad, const Eigen::Vector3d& axis, const Eigen::Vector3d& t) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(angle_rad, axis.normalized()).toRotationMatrix();
  T.translation() = t;
  return T;
}

void expect_near(const Matrix6d& a, const Matrix6d& b, double relative) {
  EXPECT_LT((a - b).cwiseAbs().maxCoeff(), relative * b.cwiseAbs().maxCoeff()) << a << "\n\n" << b;
}

/// Roll, pitch and yaw of any size, mountings with x upward (a pitch of 90 degrees) among them.
std::vector<Eigen::Isometry3d> attitudes() {
  return {turned(0.0, {0, 0, 1}, {1, 2, 3}),       turned(0.3, {1, 2, -1}, {5, -2, 0.3}),
          turned(1.5708, {0, 1, 0}, {0.5, 0, 2}),  turned(-1.57079633, {0, 1, 0}, {3, 1, 0}),
          turned(2.5, {0.2, 1, 0.1}, {10, 20, 1}), turned(3.1, {0, 0, 1}, {-4, 0, 0})};
}

TEST(PosePdf, CompositionAddsTheFirstErrorCarriedIntoTheLastFrame) {
  for (const Eigen::Isometry3d& T_a_b : attitudes()) {
    for (const Eigen::Isometry3d& T_b_c : attitudes()) {
      const PosePdf a{T_a_b, some_covariance(1, 0.03)};
      const PosePdf b{T_b_c, some_covariance(2, 0.01)};
      const PosePdf both = composed(a, b);
      EXPECT_LT((both.T.matrix() - (T_a_b * T_b_c).matrix()).cwiseAbs().maxCoeff(), 1e-12);
      const Matrix6d carry = adjoint(T_b_c.inverse());
      expect_near(both.covariance, carry * a.covariance * carry.transpose() + b.covariance, 1e-6);
    }
  }
}

TEST(PosePdf, FusionWeighsByInformationAndFollowsTheFrame) {
  const Matrix6d tight = 1e-4 * Matrix6d::Identity();
  Matrix6d open = tight;
  open(0, 0) = 100.0;
  for (const Eigen::Isometry3d& T : attitudes()) {
    Vector6d apart = Vector6d::Zero();
    apart[0] = 0.5;
    apart[1] = 0.02;
    const PosePdf result = fused({T, tight}, {T * maps::exp_se3(apart), open});
    const Vector6d moved = maps::log_se3(T.inverse() * result.T);
    EXPECT_NEAR(moved[0], 0.0, 1e-4);   // the second says nothing along x
    EXPECT_NEAR(moved[1], 0.01, 1e-4);  // and as much as the first across it
    EXPECT_NEAR(result.covariance(0, 0), 1e-4, 1e-6);
    EXPECT_NEAR(result.covariance(1, 1), 0.5e-4, 1e-6);
    EXPECT_NEAR(result.covariance(5, 5), 0.5e-4, 1e-6);
  }
}

TEST(PosePdf, ChiSquaredCountsDeviationsOfBoth) {
  const PosePdf a{attitudes()[2], 0.01 * Matrix6d::Identity()};
  PosePdf b{a.T * maps::exp_se3(0.2 * Vector6d::Unit(1)), 0.03 * Matrix6d::Identity()};
  EXPECT_NEAR(chi_squared(a, b), 1.0, 1e-9);
  b.covariance(0, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(chi_squared(a, b) < 1e9);
}

TEST(Motion, ConstantTwistIsContinuedAndItsUncertaintyGrows) {
  const MotionModel model{TrackerOptions{}};
  MotionState state = model.at_unknown_velocity(0, {pose_at(5, 1), 1e-4 * Matrix6d::Identity()});
  state.twist << 10, 0, 0, 0, 0, 0.5;
  state.twist_covariance = 1e-2 * Matrix6d::Identity();
  double last = 0.0;
  for (const double t : {0.1, 0.5, 2.0}) {
    const MotionState next = model.predicted(state, static_cast<std::int64_t>(t * 1e9));
    const Eigen::Isometry3d expected = state.pose.T * maps::exp_se3(state.twist * t);
    EXPECT_LT((next.pose.T.matrix() - expected.matrix()).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_GT(next.pose.covariance(0, 0), last);
    last = next.pose.covariance(0, 0);
  }
  // White acceleration alone: density t^3 / 3.
  EXPECT_GT(last, 4.0 * 8.0 / 3.0);
}

/// Drives with white acceleration, poses seen with noise: predictions err as their covariances say.
TEST(Motion, PredictionsErrNoMoreThanTheirCovarianceSays) {
  TrackerOptions options;
  const MotionModel model(options);
  test::Random random(5);
  double sum = 0.0;
  int count = 0;
  for (int drive = 0; drive < 40; ++drive) {
    double position = 0.0;
    double speed = 10.0;
    const auto seen = [&](std::int64_t stamp_ns, const MotionState* before) {
      PosePdf pose{pose_at(position + 0.02 * random.normal(), 0.02 * random.normal()),
                   4e-4 * Matrix6d::Identity()};
      return before == nullptr ? model.at_unknown_velocity(stamp_ns, pose)
                               : model.moved_to(*before, stamp_ns, pose);
    };
    MotionState state = seen(0, nullptr);
    for (int k = 1; k <= 20; ++k) {
      for (int i = 0; i < 10; ++i) {
        speed += std::sqrt(options.acceleration_density * 0.01) * random.normal();
        position += 0.01 * speed;
      }
      if (k > 3) {
        const MotionState predicted = model.predicted(state, k * 100'000'000LL);
        const double error = predicted.pose.T.translation().x() - position;
        sum += error * error / predicted.pose.covariance(0, 0);
        ++count;
      }
      state = seen(k * 100'000'000LL, &state);
    }
    EXPECT_NEAR(state.twist[0], speed, 1.5);
  }
  // The bound that holds for any correlation costs up to a factor of two.
  EXPECT_LT(sum / count, 1.1);
  EXPECT_GT(sum / count, 0.3);
}

TEST(Motion, OdometryReplacesTheVelocity) {
  const MotionModel model{TrackerOptions{}};
  const MotionState state =
      model.at_unknown_velocity(0, {pose_at(5, 1, 1.0), 1e-4 * Matrix6d::Identity()});
  const OdometryStep odometry{0, pose_at(2, 0, 0.1, 0.0), 1e-4 * Matrix6d::Identity()};
  const MotionState next = model.predicted(state, 500'000'000, odometry);
  EXPECT_TRUE(next.pose.T.isApprox(state.pose.T * odometry.T_since_lidar, 1e-12));
  EXPECT_NEAR(next.twist[5], 0.2, 1e-9);
  EXPECT_LT(next.pose.covariance(0, 0), 1e-3);
}

TEST(Motion, InterpolationLiesBetweenAndIsSureAtTheEnds) {
  const MotionModel model{TrackerOptions{}};
  const PosePdf a{pose_at(0, 0, 0.0), 1e-4 * Matrix6d::Identity()};
  const PosePdf b{pose_at(10, 0, 0.2), 4e-4 * Matrix6d::Identity()};
  const MotionState before = model.at_unknown_velocity(0, a);
  const MotionState after = model.at_unknown_velocity(1'000'000'000, b);
  expect_near(model.interpolated(before, after, 0).pose.covariance, a.covariance, 1e-9);
  expect_near(model.interpolated(before, after, 1'000'000'000).pose.covariance, b.covariance, 1e-9);
  const MotionState middle = model.interpolated(before, after, 500'000'000);
  EXPECT_NEAR(middle.pose.T.translation().x(), 5.0, 0.2);
  EXPECT_NEAR(maps::log_se3(middle.pose.T)[5], 0.1, 1e-9);
  EXPECT_NEAR(middle.twist[0], 10.0, 0.1);
  EXPECT_GT(middle.pose.covariance(0, 0), 0.05);
}

}  // namespace motion_test
}  // namespace stillmap::localization
