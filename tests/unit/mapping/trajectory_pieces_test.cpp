#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/frames.hpp>

#include <cmath>
#include <numbers>

#include <stillmap/localization/adjoint.hpp>
#include "support/synthetic_world.hpp"
#include "trajectory/corrected_poses.hpp"
#include "trajectory/given_pose_errors.hpp"
#include "trajectory/keyframes.hpp"
#include "trajectory/levelling.hpp"
#include "trajectory/trajectory_graph.hpp"

namespace stillmap::mapping {
namespace trajectory_pieces_test {

using ::testing::ElementsAre;
using ::testing::Optional;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

Eigen::Isometry3d turned(double x, double y, double yaw_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(x, y, 0.0);
  T.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return T;
}

OdometryPose pose_of(const Eigen::Isometry3d& T_odom_lidar) {
  OdometryPose pose;
  pose.T_odom_lidar = T_odom_lidar;
  return pose;
}

double distance(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return maps::log_se3(a.inverse() * b).norm();
}

TEST(DisagreementsOf, ATearShowsTenMetresBeforeAndAfterItHoweverFastTheDrive) {
  for (const double step_m : {0.5, 2.5}) {
    std::vector<OdometryPose> odometry;
    std::vector<Eigen::Isometry3d> given;
    for (double x = 0.0; x < 100.0; x += step_m) {
      OdometryPose pose = pose_of(turned(x, 0.0, 0.0));
      pose.status = OdometryStatus::kMatched;
      odometry.push_back(pose);
      given.push_back(turned(x, x > 50.0 ? 0.3 : 0.0, 0.0));
    }
    const auto found = disagreements_of({odometry, given});
    ASSERT_EQ(found.size(), given.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      const double from_tear_m = std::abs(step_m * static_cast<double>(i) - 50.0);
      if (std::abs(from_tear_m - 10.0) <= step_m) continue;
      EXPECT_NEAR(found[i].m, from_tear_m < 10.0 ? 0.3F : 0.0F, 1e-5F) << step_m << " " << i;
    }
  }
}

TEST(DisagreementsOf, OneScanThatOdometryMisplacesIsNoTear) {
  std::vector<OdometryPose> odometry;
  std::vector<Eigen::Isometry3d> given;
  for (int i = 0; i < 60; ++i) {
    const bool misplaced = i < 5 || i == 30;
    odometry.push_back(pose_of(turned(i, misplaced ? 0.2 : 0.0, 0.0)));
    odometry.back().status = OdometryStatus::kMatched;
    given.push_back(turned(i, 0.0, 0.0));
  }
  for (const maps::PoseDisagreement& each : disagreements_of({odometry, given}))
    EXPECT_NEAR(each.m, 0.0F, 1e-5F);
}

TEST(KeyframeChooser, TakesTheFirstScanAndThenOneAMetreOrTenDegrees) {
  KeyframeChooser chooser;
  EXPECT_TRUE(chooser.add(pose_of(turned(0.0, 0.0, 0.0))));
  EXPECT_FALSE(chooser.add(pose_of(turned(0.6, 0.0, 0.0))));
  const auto moved = chooser.add(pose_of(turned(1.2, 0.0, 0.0)));
  ASSERT_TRUE(moved);
  EXPECT_DOUBLE_EQ(moved->T_before_this.translation().x(), 1.2);
  EXPECT_FALSE(chooser.add(pose_of(turned(1.2, 0.0, 0.17))));
  EXPECT_TRUE(chooser.add(pose_of(turned(1.2, 0.0, 0.18))));
}

TEST(KeyframeChooser, HiddenScansAreNoneAndCountUntilOneIsMatched) {
  OdometryPose hidden = pose_of(turned(2.0, 0.0, 0.0));
  hidden.hidden = true;
  hidden.covariance = Matrix6d::Identity();
  for (const OdometryStatus status :
       {OdometryStatus::kMatched, OdometryStatus::kPartly, OdometryStatus::kPredicted}) {
    KeyframeChooser chooser;
    EXPECT_FALSE(chooser.add(hidden));
    EXPECT_TRUE(chooser.add(pose_of(turned(0.0, 0.0, 0.0)))) << "the first one that sees";
    EXPECT_FALSE(chooser.add(hidden));
    OdometryPose after = pose_of(turned(4.0, 0.0, 0.0));
    after.status = status;
    const auto chosen = chooser.add(after);
    ASSERT_TRUE(chosen);
    EXPECT_DOUBLE_EQ(chosen->T_before_this.translation().x(), 4.0);
    EXPECT_NEAR(chosen->by_matches(0, 0), status == OdometryStatus::kMatched ? 0.0 : 1.0, 1e-12);
  }
}

TEST(KeyframeChooser, CarriesTheErrorOfATurnToWhereItShows) {
  // One degree of yaw that is not known at the start is 17 mm to the side a metre on.
  KeyframeChooser chooser;
  (void)chooser.add(pose_of(turned(0.0, 0.0, 0.0)));
  OdometryPose start = pose_of(turned(0.0, 0.0, 0.0));
  start.covariance(5, 5) = std::pow(std::numbers::pi / 180.0, 2);
  EXPECT_FALSE(chooser.add(start));
  KeyframeChooser other;
  (void)other.add(pose_of(turned(0.0, 0.0, 0.0)));
  const auto with = chooser.add(pose_of(turned(1.0, 0.0, 0.0)));
  const auto without = other.add(pose_of(turned(1.0, 0.0, 0.0)));
  ASSERT_TRUE(with && without);
  const Matrix6d added = with->covariance() - without->covariance();
  EXPECT_NEAR(std::sqrt(added(1, 1)), std::numbers::pi / 180.0, 1e-9);
  EXPECT_NEAR(added(0, 0), 0.0, 1e-12);
}

TEST(Adjoint, CarriesATwistThroughAPose) {
  const Eigen::Isometry3d T = maps::exp_se3((Vector6d() << 1, -2, 3, 0.4, -0.5, 0.6).finished());
  const Vector6d x = 1e-3 * (Vector6d() << 3, 1, -2, 1, 2, -1).finished();
  EXPECT_LT(distance(T * maps::exp_se3(x), maps::exp_se3(localization::adjoint(T) * x) * T), 1e-12);
}

class CorrectedPoses : public ::testing::Test {
 protected:
  CorrectedPoses() {
    for (int i = 0; i < 7; ++i) odometry_.push_back(pose_of(turned(i, 0.1 * i, 0.05 * i)));
  }
  std::vector<OdometryPose> odometry_;
  std::vector<std::size_t> keyframes_{0, 2, 5};
};

TEST_F(CorrectedPoses, FollowTheKeyFramesOfARigidMotionExactly) {
  const Eigen::Isometry3d T_map_odom = turned(30.0, -4.0, 1.0);
  std::vector<Eigen::Isometry3d> corrected;
  for (const std::size_t k : keyframes_)
    corrected.push_back(T_map_odom * odometry_[k].T_odom_lidar);
  const auto poses = corrected_poses(odometry_, keyframes_, corrected);
  ASSERT_EQ(poses.size(), odometry_.size());
  for (std::size_t i = 0; i < poses.size(); ++i)
    EXPECT_LT(distance(poses[i], T_map_odom * odometry_[i].T_odom_lidar), 1e-12);
}

TEST_F(CorrectedPoses, SpreadACorrectionOverTheWayBetweenKeyFrames) {
  std::vector<Eigen::Isometry3d> corrected;
  for (const std::size_t k : keyframes_) corrected.push_back(odometry_[k].T_odom_lidar);
  corrected[2].translation().z() += 0.3;
  const auto poses = corrected_poses(odometry_, keyframes_, corrected);
  EXPECT_EQ(poses[2].matrix(), corrected[1].matrix());
  EXPECT_EQ(poses[5].matrix(), corrected[2].matrix());
  EXPECT_NEAR(poses[1].translation().z(), 0.0, 1e-12);
  EXPECT_NEAR(poses[3].translation().z(), 0.1, 1e-3);
  EXPECT_NEAR(poses[4].translation().z(), 0.2, 1e-3);
  EXPECT_NEAR(poses[6].translation().z(), 0.3, 1e-3) << "what comes after the last one follows it";
}

TEST_F(CorrectedPoses, ScansBeforeTheFirstKeyFrameFollowIt) {
  const Eigen::Isometry3d T_map_odom = turned(30.0, -4.0, 1.0);
  const auto poses = corrected_poses(
      odometry_, std::vector<std::size_t>{2, 5},
      std::vector{T_map_odom * odometry_[2].T_odom_lidar, T_map_odom * odometry_[5].T_odom_lidar});
  ASSERT_EQ(poses.size(), odometry_.size());
  for (std::size_t i = 0; i < poses.size(); ++i)
    EXPECT_LT(distance(poses[i], T_map_odom * odometry_[i].T_odom_lidar), 1e-12);
}

TEST_F(CorrectedPoses, RefuseKeyFramesThatAreNoScans) {
  const std::vector<Eigen::Isometry3d> three(3, Eigen::Isometry3d::Identity());
  EXPECT_THROW((void)corrected_poses(odometry_, std::vector<std::size_t>{0, 2, 7}, three),
               std::invalid_argument);
  EXPECT_THROW((void)corrected_poses(odometry_, {}, {}), std::invalid_argument);
}

/// Three drives of two key frames each; frames as wanted.
struct ThreeDrives {
  ThreeDrives() {
    for (std::size_t drive = 0; drive < 3; ++drive) {
      for (std::size_t i = 0; i < 2; ++i)
        keyframes.push_back({.drive = drive,
                             .scan = i,
                             .T_odom_lidar = turned(5.0 * static_cast<double>(i), 0.0, 0.0),
                             .T_before_this = turned(i == 0 ? 0.0 : 5.0, 0.0, 0.0),
                             .covariance = Matrix6d::Identity()});
    }
  }
  /// A loop that is right when drives lie as `frames` says.
  [[nodiscard]] Loop loop(std::size_t from, std::size_t to) const {
    const auto T_common = [&](std::size_t k) -> Eigen::Isometry3d {
      return frames[keyframes[k].drive] * keyframes[k].T_odom_lidar;
    };
    Loop loop;
    loop.from = from;
    loop.to = to;
    loop.T_from_to = T_common(from).inverse() * T_common(to);
    return loop;
  }
  std::vector<DriveKeyframe> keyframes;
  std::vector<Eigen::Isometry3d> frames{turned(0.0, 0.0, 0.0), turned(3.0, 40.0, 2.0),
                                        turned(-7.0, 9.0, -1.0)};
};

TEST(DriveApart, FollowsChainsOfLoops) {
  const ThreeDrives drives;
  const auto apart = [&](const std::vector<Loop>& loops) {
    return drive_apart(3, drives.keyframes, loops);
  };
  EXPECT_EQ(apart({drives.loop(2, 4), drives.loop(0, 5)}), std::nullopt);
  EXPECT_THAT(apart({drives.loop(1, 2)}), Optional(2U));
  EXPECT_THAT(apart({drives.loop(2, 4)}), Optional(1U));
}

TEST(Levelling, TurnsATiltedSensorUprightAndPutsTheGroundAtZero) {
  test::SyntheticWorld world;
  world.boxes = {{{-40.0, 9.0, 0.0}, {40.0, 10.0, 6.0}}, {{-40.0, -10.0, 0.0}, {40.0, -9.0, 6.0}}};
  Eigen::Isometry3d T_world_upright = Eigen::Isometry3d::Identity();
  T_world_upright.translation().z() = 1.8;
  const maps::PointCloud upright = world.scan(T_world_upright, {.columns = 360});
  // A little, two tilted mounts, and one that hangs.
  for (const auto& [roll_rad, pitch_rad] : {std::pair(0.06, -0.04), std::pair(0.0, 0.44),
                                            std::pair(-0.7, 0.1), std::pair(3.12, 0.02)}) {
    const Eigen::Matrix3d R_world_lidar = (Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()) *
                                           Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitY()))
                                              .toRotationMatrix();
    maps::PointCloud scan = upright;
    for (Eigen::Vector3f& p : scan.positions) p = R_world_lidar.transpose().cast<float>() * p;
    const Eigen::Isometry3d T = T_ground_lidar(scan);
    EXPECT_NEAR(T.translation().z(), 1.8, 0.02) << roll_rad;
    const Eigen::Vector3d up_lidar = R_world_lidar.transpose() * Eigen::Vector3d::UnitZ();
    EXPECT_NEAR((T.linear() * up_lidar).z(), 1.0, 1e-4) << roll_rad;
    const Eigen::Vector3d forward = T.linear() * Eigen::Vector3d::UnitX();
    EXPECT_NEAR(forward.y(), 0.0, 1e-9) << "x stays forward";
    EXPECT_GT(forward.x(), 0.8) << roll_rad;
  }
}

TEST(Levelling, AWallIsNoGround) {
  test::SyntheticWorld world;
  world.boxes = {{{-40.0, 9.0, 0.0}, {40.0, 10.0, 6.0}}};
  maps::PointCloud scan = world.scan(Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 1.8)), {});
  std::vector<std::uint8_t> on_wall;
  for (const Eigen::Vector3f& p : scan.positions) on_wall.push_back(p.y() > 8.9F ? 1 : 0);
  scan.keep_only(on_wall);
  ASSERT_GT(scan.size(), 1000U);
  EXPECT_TRUE(T_ground_lidar(scan).isApprox(Eigen::Isometry3d::Identity()));
}

TEST(Levelling, WithoutGroundNothingIsTurned) {
  EXPECT_TRUE(T_ground_lidar({}).isApprox(Eigen::Isometry3d::Identity()));
}

TEST(TrajectoryGraph, JoinsOnlyKeyFramesOfOneDriveAndDoubtsLoops) {
  const ThreeDrives drives;
  const PoseGraph graph =
      graph_of(drives.keyframes, std::vector{drives.loop(0, 3)}, {}, drives.frames);
  EXPECT_EQ(graph.nodes.size(), 6U);
  ASSERT_EQ(graph.relative_poses.size(), 4U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(graph.relative_poses[i].from, 2 * i);
    EXPECT_EQ(graph.relative_poses[i].to, 2 * i + 1);
    EXPECT_FALSE(graph.relative_poses[i].doubtful);
  }
  EXPECT_TRUE(graph.relative_poses[3].doubtful);
  EXPECT_TRUE(graph.absolute_poses.empty() && graph.absolute_positions.empty());
}

TEST(TrajectoryGraph, GivenPosesCountAtTheEndsOfADriveAndEveryTenMetres) {
  std::vector<DriveKeyframe> keyframes;
  GivenPoses given;
  for (std::size_t i = 0; i < 26; ++i) {
    const double x = static_cast<double>(i);
    keyframes.push_back({.drive = 0,
                         .scan = i,
                         .T_odom_lidar = turned(x, 0.0, 0.0),
                         .T_before_this = turned(i == 0 ? 0.0 : 1.0, 0.0, 0.0),
                         .covariance = Matrix6d::Identity()});
    given.T_map_keyframe.push_back(turned(100.0 + x, 0.0, 0.0));
  }
  given.sigma_m = 0.5;
  given.doubtful = true;
  const PoseGraph graph = graph_of(keyframes, {}, given, {turned(100.0, 0.0, 0.0)});
  std::vector<std::size_t> nodes;
  for (const AbsolutePosition& position : graph.absolute_positions) {
    nodes.push_back(position.node);
    EXPECT_DOUBLE_EQ(position.covariance(0, 0), 0.25);
    EXPECT_TRUE(position.doubtful);
  }
  EXPECT_THAT(nodes, ElementsAre(0, 10, 20, 25));
  given.sigma_m = 0.1;
  given.sigma_rad = 0.02;
  const PoseGraph with_prior = graph_of(keyframes, {}, given, {turned(100.0, 0.0, 0.0)});
  ASSERT_EQ(with_prior.absolute_poses.size(), 4U);
  EXPECT_DOUBLE_EQ(with_prior.absolute_poses[1].covariance(5, 5), 4e-4);
}

}  // namespace trajectory_pieces_test
}  // namespace stillmap::mapping
