#include "vehicle_localizer.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "odometry_track.hpp"

namespace stillmap::vehicle {
namespace {

Eigen::Isometry3d motion(const Eigen::Vector3d& t, const Eigen::Vector3d& turn) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = t;
  if (turn.norm() > 0.0)
    T.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
  return T;
}

const Eigen::Isometry3d kT_base_lidar = motion({1.1, 0.3, 1.8}, {0.02, -0.05, 2.1});
const Eigen::Isometry3d kT_map_base = motion({40.0, -7.0, 3.0}, {0.03, 0.1, -1.2});

Matrix6d some_covariance() {
  Matrix6d root;
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (double& value : root.reshaped()) value = normal(random);
  const Eigen::Matrix<double, 6, 1> sizes{0.3, 0.2, 0.1, 0.01, 0.02, 0.04};
  return sizes.asDiagonal() * (root * root.transpose()) * sizes.asDiagonal();
}

client::PoseAnswer answer_of(const client::Prior& prior) {
  client::PoseAnswer answer;
  answer.status = "ok";
  answer.pose = prior.pose;
  answer.covariance = prior.covariance;
  return answer;
}

TEST(PriorOfAVehicle, GoesToTheLidarAndBack) {
  const Matrix6d covariance = some_covariance();
  const client::Prior prior = prior_of(kT_map_base, covariance, kT_base_lidar);
  const Estimate back = estimate_of(5, answer_of(prior), kT_base_lidar);
  EXPECT_EQ(back.stamp_ns, 5);
  EXPECT_FALSE(back.degraded);
  EXPECT_TRUE(back.T_map_base.isApprox(kT_map_base, 1e-12));
  EXPECT_TRUE(back.covariance.isApprox(covariance, 1e-9));
}

/// Poses of the lidar that scatter by the covariance about their own axes give poses of the base
/// that scatter by what `estimate_of` says, about the axes of the map.
TEST(EstimateOfAVehicle, ItsCovarianceIsThatOfTheBaseAboutTheAxesOfTheMap) {
  const Matrix6d small = 1e-4 * some_covariance();
  client::PoseAnswer answer =
      answer_of(prior_of(motion({0, 0, 0}, {0, 0, 0}), small, motion({0, 0, 0}, {0, 0, 0})));
  const client::Prior mean = prior_of(kT_map_base, small, kT_base_lidar);
  answer.pose = mean.pose;
  const Estimate estimate = estimate_of(0, answer, kT_base_lidar);
  const Eigen::Isometry3d T_map_lidar = kT_map_base * kT_base_lidar;
  const Matrix6d root = small.llt().matrixL();
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  Matrix6d seen = Matrix6d::Zero();
  constexpr int kSamples = 200'000;
  for (int i = 0; i < kSamples; ++i) {
    Eigen::Matrix<double, 6, 1> x;
    for (double& value : x) value = normal(random);
    x = root * x;
    const Eigen::Isometry3d T_map_base =
        T_map_lidar * motion(x.head<3>(), x.tail<3>()) * kT_base_lidar.inverse();
    const Eigen::AngleAxisd turn(T_map_base.linear() * kT_map_base.linear().transpose());
    Eigen::Matrix<double, 6, 1> off;
    off << T_map_base.translation() - kT_map_base.translation(), turn.angle() * turn.axis();
    seen += off * off.transpose() / kSamples;
  }
  EXPECT_LT((seen - estimate.covariance).norm(), 0.03 * estimate.covariance.norm());
}

TEST(PriorOfAVehicle, WhatIsNotToldIsWide) {
  Matrix6d planar = Matrix6d::Zero();
  planar(0, 0) = planar(1, 1) = 0.25;
  planar(5, 5) = 0.07;
  const client::Prior prior = prior_of(kT_map_base, planar, kT_base_lidar);
  const Estimate back = estimate_of(0, answer_of(prior), kT_base_lidar);
  const Eigen::Matrix<double, 6, 1> expected{0.25, 0.25, 4.0, 0.0169, 0.0169, 0.07};
  EXPECT_TRUE(back.covariance.diagonal().isApprox(expected, 1e-9)) << back.covariance.diagonal();
}

TEST(OdometryTrack, TellsPosesBetweenAndSoonAfterThoseItGot) {
  OdometryTrack track;
  EXPECT_FALSE(track.at(0));
  track.add(1'000'000'000, motion({1, 0, 0}, {0, 0, 0}));
  track.add(1'100'000'000, motion({2, 0, 0}, {0, 0, 0.2}));
  EXPECT_TRUE(track.at(1'050'000'000)->isApprox(motion({1.5, 0, 0}, {0, 0, 0.1}), 1e-9));
  EXPECT_TRUE(track.at(1'100'000'000)->isApprox(motion({2, 0, 0}, {0, 0, 0.2}), 1e-9));
  EXPECT_TRUE(track.at(1'150'000'000));
  EXPECT_FALSE(track.at(1'400'000'000));
  EXPECT_FALSE(track.at(900'000'000));
}

TEST(OdometryTrack, LeavesLateOnesOutAndStartsAgainWhenTheClockWasSetBack) {
  OdometryTrack track;
  for (const std::int64_t second : {10, 11, 12})
    track.add(second * 1'000'000'000, motion({static_cast<double>(second), 0, 0}, {0, 0, 0}));
  track.add(11'500'000'000, motion({99, 0, 0}, {0, 0, 0}));
  EXPECT_DOUBLE_EQ(track.at(11'500'000'000)->translation().x(), 11.5);
  track.add(1'000'000'000, motion({5, 0, 0}, {0, 0, 0}));
  EXPECT_FALSE(track.at(11'500'000'000));
  EXPECT_DOUBLE_EQ(track.at(1'000'000'000)->translation().x(), 5.0);
}

TEST(OdometryTrack, KeepsTenSeconds) {
  OdometryTrack track;
  for (std::int64_t i = 0; i < 300; ++i)
    track.add(i * 100'000'000, motion({0.1 * static_cast<double>(i), 0, 0}, {0, 0, 0}));
  EXPECT_FALSE(track.at(19'000'000'000));
  EXPECT_TRUE(track.at(20'000'000'000));
}

TEST(ThinProfileOfAVehicle, NamesWhatItKnows) {
  EXPECT_EQ(thin_profile_of("exact"), localization::ThinProfile::kExact);
  EXPECT_EQ(thin_profile_of("compact"), localization::ThinProfile::kCompact);
  EXPECT_EQ(thin_profile_of("none"), std::nullopt);
  EXPECT_THROW(static_cast<void>(thin_profile_of("small")), std::invalid_argument);
}

}  // namespace
}  // namespace stillmap::vehicle
