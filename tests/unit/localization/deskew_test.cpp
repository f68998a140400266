#include "align/deskew.hpp"
#include "index/index_window.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <algorithm>
#include <limits>
#include <memory>
#include <stdexcept>

/// Scans that were taken on the move.
namespace stillmap::localization {
namespace sweep_motion_test {

using test::pose_at;
using ::testing::Contains;
using ::testing::IsEmpty;
using ::testing::Not;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

struct Street {
  test::SyntheticWorld world = test::street(41);
  std::shared_ptr<const MapIndex> index;
  std::unique_ptr<Aligner> aligner;
  Street() {
    std::vector<Eigen::Isometry3d> poses;
    for (double x = 15.0; x <= 105.0; x += 3.0) poses.push_back(pose_at(x, 0.0));
    index = MapIndex::build(world.mapped_from(poses, pattern(50)));
    aligner = make_aligner("default", index, poses);
  }
};
const Street& street() {
  static const Street built;
  return built;
}

Vector6d twist_of(double speed_m_s, double turn_rad_s) {
  return (Vector6d() << speed_m_s, 0.0, 0.0, 0.0, 0.0, turn_rad_s).finished();
}

double error_m(const AlignmentResult& result, const Eigen::Isometry3d& T_map_lidar) {
  return (T_map_lidar.inverse() * result.T_map_lidar).translation().norm();
}

/// Whether each error is within its protection level.
bool is_protected(const AlignmentResult& result, const Eigen::Isometry3d& T_map_lidar) {
  const Vector6d error = maps::log_se3(T_map_lidar.inverse() * result.T_map_lidar);
  return std::abs(error[0]) < result.protection.longitudinal_m &&
         std::abs(error[1]) < result.protection.lateral_m &&
         std::abs(error[2]) < result.protection.vertical_m &&
         std::abs(error[5]) < result.protection.yaw_rad;
}

TEST(SweepMotion, TheMapTellsTwistAndPoseAtTheStamp) {
  const Eigen::Isometry3d T = pose_at(60.0, 0.5, 0.1);
  const Vector6d twist = twist_of(12.0, 0.4);
  const maps::PointCloud scan = street().world.sweep(T, twist, pattern(3), -0.1, 0.0);
  Query query = query_of(picked(view_of(scan), thin_points(view_of(scan))), T.linear());
  ASSERT_EQ(query.time_offsets_s.size(), query.points.size());
  // Taken as it came it fits where the sensor was in between.
  Eigen::Isometry3d T_index_lidar = T * maps::exp_se3(-0.05 * twist);
  const auto window = street().index->around(T.translation());
  T_index_lidar = window->from_map(T_index_lidar);
  const SweepMotion motion = deskew(window->levels(), query, T_index_lidar);
  EXPECT_LT((motion.twist - twist).head<3>().norm(), 0.3) << motion.twist.transpose();
  EXPECT_LT((motion.twist - twist).tail<3>().norm(), 0.02) << motion.twist.transpose();
  T_index_lidar = window->to_map(T_index_lidar);
  EXPECT_LT((T.inverse() * T_index_lidar).translation().norm(), 0.03);
  EXPECT_GT(motion.pose_covariance(0, 0), 0.0);
}

TEST(SweepMotion, ScansWithTimesAreOkWithinTheirProtectionAtAnySpeed) {
  std::uint64_t seed = 100;
  for (const double speed_m_s : {-3.0, 0.0, 2.0, 5.0, 10.0, 20.0, 30.0}) {
    for (const double begin_s : {-0.1, -0.05, 0.0}) {
      const Eigen::Isometry3d T = pose_at(60.0, 0.5, 0.1);
      const maps::PointCloud scan = street().world.sweep(T, twist_of(speed_m_s, 0.02 * speed_m_s),
                                                         pattern(++seed), begin_s, begin_s + 0.1);
      const AlignmentResult result = street().aligner->align(scan, Prior{pose_at(59.5, 0.0), {}});
      EXPECT_LT(error_m(result, T), 0.05) << speed_m_s << " " << begin_s;
      EXPECT_THAT(result.reasons, IsEmpty()) << speed_m_s << " " << begin_s;
      EXPECT_TRUE(is_protected(result, T)) << speed_m_s << " " << begin_s;
    }
  }
}

TEST(SweepMotion, ScansWithoutTimesThatWereTakenOnTheMoveAreNotOk) {
  std::uint64_t seed = 200;
  for (const double speed_m_s : {-6.0, 5.0, 10.0, 20.0}) {
    const Eigen::Isometry3d T = pose_at(60.0, 0.5, 0.1);
    maps::PointCloud scan =
        street().world.sweep(T, twist_of(speed_m_s, 0.0), pattern(++seed), -0.05, 0.05);
    scan.time_offsets_s.clear();
    const AlignmentResult result = street().aligner->align(scan, Prior{pose_at(59.5, 0.0), {}});
    EXPECT_EQ(result.status, PoseStatus::kDegraded) << speed_m_s;
    EXPECT_THAT(result.reasons, Contains(Reason::kNotDeskewed)) << speed_m_s;
    // Where the sensor looked ahead, in the middle of this turn.
    EXPECT_LT(error_m(result, T), 0.05) << speed_m_s;
  }
}

TEST(SweepMotion, ScansOfOneInstantHaveNone) {
  for (const double x : {40.0, 60.0, 80.0}) {
    const Eigen::Isometry3d T = pose_at(x, 0.5, 0.1);
    maps::PointCloud scan = street().world.scan(T, pattern(7));
    const AlignmentResult without = street().aligner->align(scan, Prior{pose_at(x, 0.0), {}});
    EXPECT_THAT(without.reasons, IsEmpty()) << x;
    scan.time_offsets_s.assign(scan.size(), 0.0F);
    const AlignmentResult zeros = street().aligner->align(scan, Prior{pose_at(x, 0.0), {}});
    EXPECT_EQ(zeros.T_map_lidar.matrix(), without.T_map_lidar.matrix()) << x;
    // What little motion may be left in it hardly counts.
    EXPECT_LT(zeros.covariance.trace(), 1.01 * without.covariance.trace()) << x;
  }
}

TEST(SweepMotion, WhoSaysThatAScanIsOfOneInstantIsBelieved) {
  const Eigen::Isometry3d T = pose_at(60.0, 0.5, 0.1);
  maps::PointCloud scan = street().world.sweep(T, twist_of(10.0, 0.0), pattern(8), -0.05, 0.05);
  std::fill(scan.time_offsets_s.begin(), scan.time_offsets_s.end(), 0.0F);
  const AlignmentResult result = street().aligner->align(scan, Prior{pose_at(60.0, 0.0), {}});
  EXPECT_THAT(result.reasons, Not(Contains(Reason::kNotDeskewed)));
}

TEST(SweepMotion, WhatNothingTellsOfTheTwistMakesThePoseVague) {
  // Between two smooth walls nothing tells how fast it went along them.
  const test::SyntheticWorld world = test::corridor();
  std::vector<Eigen::Isometry3d> poses;
  for (double x = -30.0; x <= 30.0; x += 3.0) poses.push_back(pose_at(x, 0.0));
  const auto index = MapIndex::build(world.mapped_from(poses, pattern(60)));
  const maps::PointCloud scan =
      world.sweep(pose_at(0.0, 0.0), twist_of(10.0, 0.0), pattern(9), 0.0, 0.1);
  const AlignmentResult result =
      make_aligner("default", index)->align(scan, Prior{pose_at(0.0, 0.3), {}});
  EXPECT_EQ(result.status, PoseStatus::kDegraded);
  EXPECT_LT(std::abs(result.T_map_lidar.translation().y()), 0.05);
  EXPECT_GT(result.covariance(0, 0), 1.0);
}

TEST(SweepMotion, RefusesTimesThatDoNotGoWithThePoints) {
  maps::PointCloud scan = street().world.scan(pose_at(60.0, 0.0), pattern(7));
  const Prior prior{pose_at(60.0, 0.0), {}};
  scan.time_offsets_s = {0.0F};
  EXPECT_THROW((void)street().aligner->align(scan, prior), std::invalid_argument);
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), 11.0F, -1e30F}) {
    scan.time_offsets_s.assign(scan.size(), 0.0F);
    scan.time_offsets_s.back() = bad;
    EXPECT_THROW((void)street().aligner->align(scan, prior), std::invalid_argument) << bad;
  }
}

}  // namespace sweep_motion_test
}  // namespace stillmap::localization
