#include "evaluation/odometry/trajectory_errors.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

namespace stillmap::mapping {
namespace trajectory_errors_test {

constexpr double kDeg = std::numbers::pi / 180.0;

using Poses = std::vector<Eigen::Isometry3d>;

Eigen::Isometry3d pose(double x_m, double y_m, double yaw_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T.translation() = Eigen::Vector3d(x_m, y_m, 0.0);
  return T;
}

/// Along x.
Poses straight(std::size_t poses, double step_m, double scale = 1.0) {
  Poses path;
  for (std::size_t i = 0; i < poses; ++i)
    path.push_back(pose(scale * step_m * static_cast<double>(i), 0.0, 0.0));
  return path;
}

/// A path that turns, climbs and comes back.
Poses winding(std::size_t poses) {
  Poses path;
  for (std::size_t i = 0; i < poses; ++i) {
    const double t = 0.02 * static_cast<double>(i);
    Eigen::Isometry3d T = pose(60.0 * std::sin(t), 40.0 * std::sin(2.0 * t), 1.7 * t);
    T.translation().z() = 3.0 * std::sin(0.7 * t);
    path.push_back(T * Eigen::AngleAxisd(0.1 * std::sin(t), Eigen::Vector3d::UnitY()));
  }
  return path;
}

Eigen::Isometry3d some_motion() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() =
      Eigen::AngleAxisd(2.1, Eigen::Vector3d(0.3, -0.5, 0.8).normalized()).toRotationMatrix();
  T.translation() = Eigen::Vector3d(120.0, -7.0, 3.0);
  return T;
}

TEST(TrajectoryErrors, AScaleOfOnePercentIsAnErrorOfOnePercent) {
  const TrajectoryErrors errors =
      trajectory_errors(straight(10001, 0.1), straight(10001, 0.1, 1.01));
  EXPECT_NEAR(errors.kitti.translation_percent, 1.0, 2e-3);
  EXPECT_NEAR(errors.kitti.rotation_deg_per_100m, 0.0, 1e-9);
  EXPECT_NEAR(errors.relative.translation_percent_10m, 1.0, 1e-9);
  EXPECT_NEAR(errors.relative.rotation_deg_10m, 0.0, 1e-9);
  ASSERT_EQ(errors.kitti.lengths.size(), 8U);
  for (const LengthErrors& each : errors.kitti.lengths)
    EXPECT_NEAR(each.translation_percent, 1.0, 2e-3) << each.length_m;
}

TEST(TrajectoryErrors, DistancesOfAScaledLineAreThoseOfItsCentreOrItsStart) {
  // 1001 poses on 1000 m, 1 % too long: from the start up to 10 m, aligned +-5 m.
  const TrajectoryErrors errors = trajectory_errors(straight(1001, 1.0), straight(1001, 1.0, 1.01));
  EXPECT_NEAR(errors.from_start_m.max, 10.0, 1e-9);
  EXPECT_NEAR(errors.from_start_m.mean, 5.0, 1e-9);
  EXPECT_NEAR(errors.aligned_m.max, 5.0, 1e-9);
  EXPECT_NEAR(errors.aligned_m.mean, 2.5 * 1001.0 / 1001.0, 0.01);
  EXPECT_NEAR(errors.aligned_m.rmse, 10.0 / std::sqrt(12.0), 0.01);
  EXPECT_NEAR(errors.way_m, 1000.0, 1e-9);
  ASSERT_EQ(errors.course_m.size(), 1001U);
  EXPECT_NEAR(errors.course_m[400][0], 400.0, 1e-9);
  EXPECT_NEAR(errors.course_m[400][1], 1.0, 1e-9);
  EXPECT_NEAR(errors.course_m[400][2], 4.0, 1e-9);
}

TEST(TrajectoryErrors, TheDevkitDividesByTheLengthAskedFor) {
  // Steps of 3 m: the first pose beyond 100 m is at 102 m, off by 1.02 m; beyond 10 m at 12 m.
  const Poses truth = straight(36, 3.0);
  const Poses estimate = straight(36, 3.0, 1.01);
  const TrajectoryErrors errors = trajectory_errors(truth, estimate);
  ASSERT_EQ(errors.kitti.segments, 1U);
  EXPECT_NEAR(errors.kitti.translation_percent, 1.02, 1e-9);
  EXPECT_NEAR(errors.relative.translation_percent_10m, 1.0, 1e-9);
  EXPECT_EQ(errors.relative.segments_10m, 32U);
}

TEST(TrajectoryErrors, AConstantDriftOfYawIsThatManyDegrees) {
  // Straight on in truth, turning by 2 deg in 100 m in the estimate.
  const std::size_t poses = 2001;
  const double step_m = 0.5;
  const double turn = 2.0 * kDeg * step_m / 100.0;
  Poses estimate{Eigen::Isometry3d::Identity()};
  for (std::size_t i = 1; i < poses; ++i) estimate.push_back(estimate.back() * pose(0.5, 0, turn));
  const TrajectoryErrors errors = trajectory_errors(straight(poses, step_m), estimate);
  EXPECT_NEAR(errors.kitti.rotation_deg_per_100m, 2.0, 0.01);
  EXPECT_NEAR(errors.relative.rotation_deg_10m, 0.2, 1e-9);
  EXPECT_NEAR(errors.relative.step_rotation_deg.max, 0.01, 1e-9);
  // The chord of an arc of 100 m and 2 deg ends 1.745 m beside the line.
  EXPECT_NEAR(errors.kitti.lengths[0].translation_percent, 1.75, 0.02);
  EXPECT_GT(errors.kitti.lengths[7].translation_percent, 10.0);
}

TEST(TrajectoryErrors, FramesDoNotMatter) {
  const Poses truth = winding(600);
  Poses estimate;
  for (const Eigen::Isometry3d& T : truth) estimate.push_back(some_motion() * T);
  const TrajectoryErrors errors = trajectory_errors(truth, estimate);
  EXPECT_NEAR(errors.aligned_m.max, 0.0, 1e-9);
  EXPECT_NEAR(errors.from_start_m.max, 0.0, 1e-9);
  EXPECT_NEAR(errors.kitti.translation_percent, 0.0, 1e-9);
  EXPECT_NEAR(errors.kitti.rotation_deg_per_100m, 0.0, 1e-9);
  EXPECT_NEAR(errors.relative.step_translation_m.max, 0.0, 1e-9);
  EXPECT_TRUE(errors.T_truth_estimate.isApprox(some_motion().inverse(), 1e-9));
}

TEST(TrajectoryErrors, OnePoseBesideItsPlaceIsAnErrorOfThatPose) {
  const Poses truth = winding(600);
  Poses estimate = truth;
  estimate[300].translation().z() += 6.0;
  const TrajectoryErrors errors = trajectory_errors(truth, estimate);
  EXPECT_NEAR(errors.from_start_m.max, 6.0, 1e-9);
  EXPECT_NEAR(errors.from_start_m.mean, 6.0 / 600.0, 1e-9);
  EXPECT_NEAR(errors.from_start_m.rmse, 6.0 / std::sqrt(600.0), 1e-9);
  EXPECT_NEAR(errors.from_start_m.median, 0.0, 1e-12);
  EXPECT_LT(errors.aligned_m.rmse, errors.from_start_m.rmse);
  EXPECT_NEAR(errors.relative.step_translation_m.max, 6.0, 1e-6);
}

TEST(TrajectoryErrors, AlignmentIsTheBestRigidMotion) {
  // Any other motion makes the sum of squares larger.
  const Poses truth = winding(200);
  Poses estimate;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    Eigen::Isometry3d T = some_motion() * truth[i];
    const auto t = static_cast<double>(i);
    T.translation() += Eigen::Vector3d(std::sin(t), std::cos(2.0 * t), std::sin(3.0 * t));
    estimate.push_back(T);
  }
  const Eigen::Isometry3d best = alignment_of(truth, estimate);
  const double rmse_m = figures_of(distances_m(truth, estimate, best)).rmse;
  EXPECT_NEAR(best.linear().determinant(), 1.0, 1e-12);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double by : {-1e-3, 1e-3}) {
      Eigen::Isometry3d shifted = best;
      shifted.translation()[axis] += by;
      EXPECT_GT(figures_of(distances_m(truth, estimate, shifted)).rmse, rmse_m);
      const Eigen::Isometry3d turned = best * Eigen::AngleAxisd(by, Eigen::Vector3d::Unit(axis));
      EXPECT_GT(figures_of(distances_m(truth, estimate, turned)).rmse, rmse_m);
    }
  }
}

TEST(TrajectoryErrors, AnEstimateThatIsAMirrorImageIsNotMirroredBack) {
  const Poses truth = winding(200);
  Poses estimate = truth;
  for (Eigen::Isometry3d& T : estimate) T.translation().y() = -T.translation().y();
  EXPECT_NEAR(alignment_of(truth, estimate).linear().determinant(), 1.0, 1e-12);
  EXPECT_GT(trajectory_errors(truth, estimate).aligned_m.rmse, 1.0);
}

TEST(TrajectoryErrors, AStraightLineIsAlignedWithoutRolling) {
  // Another heading in the estimate's frame; any roll about the line would fit as well.
  Poses estimate;
  for (const Eigen::Isometry3d& T : straight(300, 1.0)) estimate.push_back(pose(5, 6, 2.0) * T);
  const Poses truth = straight(300, 1.0);
  const TrajectoryErrors errors = trajectory_errors(truth, estimate);
  EXPECT_NEAR(errors.aligned_m.max, 0.0, 1e-9);
  EXPECT_TRUE(errors.T_truth_estimate.isApprox(pose(5, 6, 2.0).inverse(), 1e-9));
}

TEST(TrajectoryErrors, AVehicleThatStoodHasDistancesButNoPercentages) {
  const Poses truth(20, pose(3.0, 4.0, 0.5));
  const TrajectoryErrors errors = trajectory_errors(truth, Poses(20, pose(1.0, 1.0, 0.1)));
  EXPECT_NEAR(errors.aligned_m.max, 0.0, 1e-12);
  EXPECT_NEAR(errors.way_m, 0.0, 1e-12);
  EXPECT_TRUE(std::isnan(errors.kitti.translation_percent));
  EXPECT_TRUE(std::isnan(errors.relative.translation_percent_10m));
}

TEST(TrajectoryErrors, ADriveShorterThanALengthSaysNothingAboutIt) {
  const TrajectoryErrors nothing = trajectory_errors(straight(100, 1.0), straight(100, 1.0));
  EXPECT_EQ(nothing.kitti.segments, 0U);
  EXPECT_TRUE(nothing.kitti.lengths.empty());
  EXPECT_TRUE(std::isnan(nothing.kitti.translation_percent));
  EXPECT_TRUE(std::isnan(nothing.kitti.rotation_deg_per_100m));
  EXPECT_NEAR(nothing.relative.translation_percent_10m, 0.0, 1e-12);
  const TrajectoryErrors some = trajectory_errors(straight(251, 1.0), straight(251, 1.0));
  ASSERT_EQ(some.kitti.lengths.size(), 2U);
  // From poses 0, 10 ... 140, whose first pose farther than 100 m is there.
  EXPECT_EQ(some.kitti.lengths[0].segments, 15U);
  EXPECT_EQ(some.kitti.lengths[1].segments, 5U);
  EXPECT_EQ(some.kitti.segments, 20U);
}

TEST(TrajectoryErrors, OnePoseHasNoMotion) {
  const TrajectoryErrors errors = trajectory_errors(straight(1, 1.0), straight(1, 1.0));
  EXPECT_NEAR(errors.aligned_m.max, 0.0, 1e-12);
  EXPECT_TRUE(std::isnan(errors.relative.step_translation_m.mean));
}

TEST(TrajectoryErrors, RejectsWhatIsNoPair) {
  EXPECT_THROW((void)trajectory_errors(straight(3, 1.0), straight(4, 1.0)), std::invalid_argument);
  EXPECT_THROW((void)trajectory_errors(Poses{}, Poses{}), std::invalid_argument);
  Poses broken = straight(3, 1.0);
  broken[1].translation().y() = std::numeric_limits<double>::quiet_NaN();
  try {
    (void)trajectory_errors(straight(3, 1.0), broken);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(std::string(error.what()), testing::HasSubstr("estimate: pose 1"));
  }
}

TEST(ErrorFigures, AreMeanRootMeanSquareMedianAndLargest) {
  const ErrorFigures odd = figures_of({3.0, 0.0, 4.0});
  EXPECT_NEAR(odd.mean, 7.0 / 3.0, 1e-12);
  EXPECT_NEAR(odd.rmse, std::sqrt(25.0 / 3.0), 1e-12);
  EXPECT_NEAR(odd.median, 3.0, 1e-12);
  EXPECT_NEAR(odd.max, 4.0, 1e-12);
  EXPECT_NEAR(figures_of({1.0, 2.0}).median, 1.5, 1e-12);
}

}  // namespace trajectory_errors_test
}  // namespace stillmap::mapping
