#include "calibration/hand_eye.hpp"

#include <gtest/gtest.h>
#include <stillmap/mapping/lidar_calibration.hpp>
#include <stillmap/maps/frames.hpp>

#include <cmath>
#include <random>

namespace stillmap::mapping {
namespace hand_eye_test {

using maps::Vector6d;

Eigen::Isometry3d mount() {
  Vector6d values;
  values << 1.2, -0.4, -0.7, 0.05, 0.2, 2.9;
  return changed_mount(Eigen::Isometry3d::Identity(), values);
}

Vector6d twist(double x, double y, double z, double rx, double ry, double rz) {
  return (Vector6d() << x, y, z, rx, ry, rz).finished();
}

/// As the lidar feels a motion of the reference.
MotionPair pair_of(const Eigen::Isometry3d& T_reference) {
  return {T_reference, mount().inverse() * T_reference * mount()};
}

/// Ways and turns of a vehicle on a plane; `tilt` adds roll and pitch.
std::vector<MotionPair> drive(double tilt, double noise_m = 0.0, double noise_rad = 0.0,
                              unsigned seed = 1) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal;
  const auto noise = [&] {
    Vector6d e;
    for (Eigen::Index k = 0; k < 6; ++k) e[k] = (k < 3 ? noise_m : noise_rad) * normal(engine);
    return maps::exp_se3(e);
  };
  std::vector<MotionPair> motions;
  for (int i = 0; i < 60; ++i) {
    const double turn = 1.2 * std::sin(0.9 * i);
    MotionPair motion =
        pair_of(maps::exp_se3(twist(20.0, 0.0, 0.0, tilt * std::sin(1.7 * i),
                                    tilt * std::cos(2.3 * i), i % 3 == 0 ? 0.0 : turn)));
    motion.T_reference = motion.T_reference * noise();
    motion.T_lidar = motion.T_lidar * noise();
    motions.push_back(motion);
  }
  return motions;
}

TEST(HandEye, ExactMotionsTellTheMountExactly) {
  const auto found = fit_hand_eye(drive(0.3));
  ASSERT_TRUE(found);
  EXPECT_LT(difference_of_mounts(found->T_reference_lidar, mount()).norm(), 1e-6);
  EXPECT_LT(found->covariance.diagonal().maxCoeff(), 1e-6);
}

TEST(HandEye, APlaneDoesNotTellTheHeight) {
  const auto found = fit_hand_eye(drive(0.0));
  ASSERT_TRUE(found);
  Vector6d off = difference_of_mounts(found->T_reference_lidar, mount());
  const Vector6d sigma = found->covariance.diagonal().cwiseSqrt();
  EXPECT_NEAR(sigma.z(), kUnknownMountM, 0.01);
  off.z() = 0.0;
  EXPECT_LT(off.norm(), 1e-6);
  for (const Eigen::Index k : {0, 1, 3, 4, 5}) EXPECT_LT(sigma[k], 1e-3) << k;
}

TEST(HandEye, StraightWaysTellNoTurnAboutThem) {
  std::vector<MotionPair> straight(20, pair_of(maps::exp_se3(twist(20, 0, 0, 0, 0, 0))));
  EXPECT_FALSE(fit_hand_eye(straight));
  EXPECT_FALSE(fit_hand_eye(std::span(straight).first(3)));
}

TEST(HandEye, DeviationsAreThoseOfTheErrors) {
  Vector6d squares = Vector6d::Zero();
  constexpr int kDraws = 40;
  std::vector<std::size_t> blocks;
  for (std::size_t i = 0; i < 60; ++i) blocks.push_back(i / 6);
  for (unsigned seed = 1; seed <= kDraws; ++seed) {
    const auto found = fit_hand_eye_in_blocks(drive(0.1, 0.02, 0.001, seed), blocks);
    ASSERT_TRUE(found);
    squares += difference_of_mounts(found->T_reference_lidar, mount())
                   .cwiseAbs2()
                   .cwiseQuotient(found->covariance.diagonal());
  }
  // A fit and a jackknife are added, so it is no more than careful.
  for (Eigen::Index k = 0; k < 6; ++k) {
    EXPECT_GT(std::sqrt(squares[k] / kDraws), 0.4) << k;
    EXPECT_LT(std::sqrt(squares[k] / kDraws), 1.2) << k;
  }
}

TEST(HandEye, WhatOneBlockAloneTellsIsNotObserved) {
  std::vector<MotionPair> motions(20, pair_of(maps::exp_se3(twist(20, 0, 0, 0, 0, 0))));
  std::vector<std::size_t> blocks;
  for (std::size_t i = 0; i < motions.size(); ++i) blocks.push_back(1 + i % 9);
  for (const MotionPair& motion : drive(0.3)) {
    motions.push_back(motion);
    blocks.push_back(0);
  }
  const auto found = fit_hand_eye_in_blocks(motions, blocks);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->covariance, unknown_mount_covariance());
}

TEST(LidarMount, SigmasAreThoseOfTheAngles) {
  LidarMount mount;
  mount.T_reference_lidar.linear() = maps::exp_so3(Eigen::Vector3d(0.0, 0.0, M_PI / 2.0));
  mount.covariance.diagonal() << 4.0, 9.0, 16.0, 0.01, 0.04, 0.09;
  // A lidar that looks left pitches about the reference's x.
  EXPECT_TRUE(
      mount.sigma().isApprox((maps::Vector6d() << 2.0, 3.0, 4.0, 0.2, 0.1, 0.3).finished(), 1e-6));
  EXPECT_NEAR(mount.values()[5], M_PI / 2.0, 1e-12);
}

TEST(HandEye, FewWrongMotionsDoNotCount) {
  std::vector<MotionPair> motions = drive(0.3, 0.01, 0.0005);
  for (std::size_t i = 0; i < 6; ++i)
    motions[9 * i].T_lidar.translation() += Eigen::Vector3d(3.0, -2.0, 1.0);
  const auto found = fit_hand_eye(motions);
  ASSERT_TRUE(found);
  EXPECT_LT(difference_of_mounts(found->T_reference_lidar, mount()).norm(), 0.05);
}

}  // namespace hand_eye_test
}  // namespace stillmap::mapping
