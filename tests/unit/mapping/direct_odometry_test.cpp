#include "odometry/run_odometry.hpp"

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <algorithm>
#include <atomic>
#include <numbers>
#include <stdexcept>
#include <vector>

namespace stillmap::mapping {
namespace direct_odometry_test {

using test::pose_at;
using ::testing::ElementsAre;
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr std::int64_t kStepNs = 100'000'000;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.rings = 20;
  out.columns = 360;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

maps::Scan scan_of(maps::PointCloud cloud, std::size_t index) {
  maps::Scan scan;
  scan.index = index;
  scan.stamp_ns = kStepNs * static_cast<std::int64_t>(index);
  scan.source = "scan " + std::to_string(index);
  scan.cloud = std::move(cloud);
  return scan;
}

/// Scans of a world from some poses, all at one instant each.
std::vector<maps::Scan> scans_from(const test::SyntheticWorld& world,
                                   const std::vector<Eigen::Isometry3d>& poses,
                                   double max_range_m = 70.0) {
  std::vector<maps::Scan> scans;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    test::ScanPattern look = pattern(i + 1);
    look.max_range_m = max_range_m;
    scans.push_back(scan_of(world.scan(poses[i], look), i));
  }
  return scans;
}

std::vector<OdometryPose> follow(const std::vector<maps::Scan>& scans) {
  const std::unique_ptr<Odometry> odometry = make_odometry("default");
  std::vector<OdometryPose> poses;
  for (const maps::Scan& scan : scans) poses.push_back(odometry->add(*odometry->prepare(scan)));
  return poses;
}

/// A curve along a street at up to 8 m/s.
std::vector<Eigen::Isometry3d> curve(std::size_t count) {
  std::vector<Eigen::Isometry3d> poses;
  for (std::size_t i = 0; i < count; ++i) {
    const double s = static_cast<double>(i);
    poses.push_back(pose_at(20.0 + 0.8 * s, 1.2 * std::sin(0.06 * s), 0.09 * std::cos(0.06 * s)));
  }
  return poses;
}

double off_m(const Eigen::Isometry3d& T_first, const Eigen::Isometry3d& T_true,
             const OdometryPose& pose) {
  return ((T_first.inverse() * T_true).inverse() * pose.T_odom_lidar).translation().norm();
}

void expect_all_finite(const std::vector<OdometryPose>& poses) {
  for (const OdometryPose& pose : poses) {
    EXPECT_TRUE(pose.T_odom_lidar.matrix().allFinite());
    EXPECT_TRUE(pose.covariance.allFinite());
    EXPECT_TRUE(pose.twist_lidar.allFinite());
    EXPECT_LT((pose.T_odom_lidar.linear() * pose.T_odom_lidar.linear().transpose() -
               Eigen::Matrix3d::Identity())
                  .norm(),
              1e-9);
  }
}

TEST(Odometry, NamesAndRefusals) {
  EXPECT_EQ(odometry_names().front(), "default");
  EXPECT_THROW((void)make_odometry("none"), std::invalid_argument);
  EXPECT_EQ(name_of(OdometryStatus::kPartly), "partly");
}

TEST(DirectOdometry, FollowsACurveToAThousandth) {
  const auto truth = curve(40);
  const auto poses = follow(scans_from(test::street(41), truth));
  expect_all_finite(poses);
  EXPECT_TRUE(poses.front().T_odom_lidar.isApprox(Eigen::Isometry3d::Identity()));
  EXPECT_LT(off_m(truth.front(), truth.back(), poses.back()), 0.04);
  EXPECT_EQ(poses.back().status, OdometryStatus::kMatched);
  EXPECT_NEAR(poses.back().twist_lidar[0], 8.0, 0.3);
  EXPECT_GT(poses.back().covariance(0, 0), 0.0);
  EXPECT_LT(poses.back().covariance(0, 0), 0.01);
}

TEST(DirectOdometry, AnUpsideDownSensorSeesTheSameMotion) {
  auto truth = curve(25);
  Eigen::Isometry3d T_base_lidar = Eigen::Isometry3d::Identity();
  T_base_lidar.linear() =
      Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX()).toRotationMatrix();
  for (Eigen::Isometry3d& T : truth) T = T * T_base_lidar;
  test::SyntheticWorld world = test::street(41);
  std::vector<maps::Scan> scans;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    test::ScanPattern look = pattern(i + 1);
    std::swap(look.lowest_rad, look.highest_rad);
    look.lowest_rad = -look.lowest_rad;
    look.highest_rad = -look.highest_rad;
    scans.push_back(scan_of(world.scan(truth[i], look), i));
  }
  const auto poses = follow(scans);
  EXPECT_LT(off_m(truth.front(), truth.back(), poses.back()), 0.06);
}

TEST(DirectOdometry, AStandingSensorStays) {
  const std::vector<Eigen::Isometry3d> truth(25, pose_at(50.0, 0.0));
  const auto poses = follow(scans_from(test::street(42), truth));
  EXPECT_LT(poses.back().T_odom_lidar.translation().norm(), 0.01);
  EXPECT_LT(maps::rotation_angle_rad(poses.back().T_odom_lidar.linear()), 1e-3);
}

TEST(DirectOdometry, FollowsATurnOf36DegreesBetweenTwoScans) {
  auto truth = curve(24);
  for (std::size_t i = 18; i < truth.size(); ++i)
    truth[i].rotate(Eigen::AngleAxisd(0.63, Eigen::Vector3d::UnitZ()));
  const auto poses = follow(scans_from(test::street(46), truth));
  for (std::size_t i = 16; i < truth.size(); ++i)
    EXPECT_LT(off_m(truth.front(), truth[i], poses[i]), 0.05) << i;
}

/// Walls and posts, then nothing but two smooth walls.
test::SyntheticWorld street_into_tunnel() {
  test::SyntheticWorld world = test::corridor();
  for (double x = 0.0; x < 24.0; x += 5.0) {
    world.boxes.push_back({{x, 2.5, 0}, {x + 1.0, 4.5, 3}});
    world.boxes.push_back({{x + 2.5, -4.5, 0}, {x + 3.5, -2.8, 3}});
  }
  return world;
}

TEST(DirectOdometry, KeepsItsSpeedInATunnelAndSaysSo) {
  // The last post is seen from scan 46 at the latest.
  constexpr std::size_t kInside = 48, kEnd = 82;
  std::vector<Eigen::Isometry3d> truth;
  for (std::size_t i = 0; i <= kEnd; ++i) {
    const auto s = static_cast<double>(i);
    truth.push_back(pose_at(1.0 + 0.8 * s, 0.1 * std::sin(0.1 * s)));
  }
  const auto poses = follow(scans_from(street_into_tunnel(), truth, 15.0));
  for (std::size_t i = 1; i < 40; ++i) EXPECT_EQ(poses[i].status, OdometryStatus::kMatched) << i;
  double last_variance_m2 = 0.0;
  double variance_m2 = 0.0;
  for (std::size_t i = kInside; i <= kEnd; ++i) {
    ASSERT_EQ(poses[i].status, OdometryStatus::kPartly) << i;
    ASSERT_EQ(poses[i].degenerate_directions.size(), 1U) << i;
    EXPECT_GT(std::abs(poses[i].degenerate_directions[0][0]), 0.95) << i;
    EXPECT_GT(poses[i].covariance(0, 0), last_variance_m2) << i;
    EXPECT_LT(poses[i].covariance(1, 1), 0.01) << i;
    last_variance_m2 = poses[i].covariance(0, 0);
    variance_m2 += last_variance_m2;
  }
  // Over 27 m along the tunnel as fast as before, across it as the walls say.
  const Eigen::Isometry3d T_true = truth[kInside].inverse() * truth[kEnd];
  const Eigen::Isometry3d T_found =
      poses[kInside].T_odom_lidar.inverse() * poses[kEnd].T_odom_lidar;
  const Eigen::Vector3d error = T_found.translation() - T_true.translation();
  EXPECT_LT(std::abs(error.x()), 0.3);
  EXPECT_LT(error.tail<2>().norm(), 0.1);
  // Nothing tells of an acceleration: half a metre per second squared is 3 m after 3.4 s.
  EXPECT_GT(std::sqrt(variance_m2), 2.5);
  EXPECT_LT(std::sqrt(variance_m2), 6.0);
}

TEST(DirectOdometry, LooksWhereItIsToldAndAlsoWhereTheSpeedLeads) {
  // Turns round on the spot at once: nothing that was seen before tells it.
  auto truth = curve(14);
  for (std::size_t i = 12; i < truth.size(); ++i)
    truth[i].rotate(Eigen::AngleAxisd(2.6, Eigen::Vector3d::UnitZ()));
  const std::vector<maps::Scan> scans = scans_from(test::street(41), truth);
  const auto told = [&] {
    const std::unique_ptr<Odometry> odometry = make_odometry("default");
    std::vector<OdometryPose> poses;
    for (std::size_t i = 0; i < scans.size(); ++i) {
      if (i > 0) odometry->expect(truth[i - 1].inverse() * truth[i]);
      poses.push_back(odometry->add(*odometry->prepare(scans[i])));
    }
    return off_m(truth.front(), truth.back(), poses.back());
  };
  EXPECT_LT(told(), 0.05);
  EXPECT_GT(off_m(truth.front(), truth.back(), follow(scans).back()), 0.3);
  // What is told is wrong: as without a word.
  truth = curve(14);
  const std::vector<maps::Scan> straight = scans_from(test::street(41), truth);
  const std::unique_ptr<Odometry> odometry = make_odometry("default");
  std::vector<OdometryPose> poses;
  for (std::size_t i = 0; i < straight.size(); ++i) {
    if (i > 11) odometry->expect(pose_at(-6.0, 3.0, 0.5));
    poses.push_back(odometry->add(*odometry->prepare(straight[i])));
  }
  EXPECT_LT(off_m(truth.front(), truth.back(), poses.back()), 0.05);
}

TEST(DirectOdometry, GoesOnThroughEmptyScansAndGapsInTime) {
  const auto truth = curve(30);
  std::vector<maps::Scan> scans = scans_from(test::street(43), truth);
  scans[12].cloud = {};
  scans[13].cloud = {};
  scans.erase(scans.begin() + 20);
  auto poses = follow(scans);
  expect_all_finite(poses);
  EXPECT_EQ(poses[12].status, OdometryStatus::kPredicted);
  EXPECT_EQ(poses[15].status, OdometryStatus::kMatched);
  EXPECT_LT(off_m(truth.front(), truth.back(), poses.back()), 0.05);
  // An hour passes between two scans.
  for (std::size_t i = 20; i < scans.size(); ++i) scans[i].stamp_ns += 3'600'000'000'000;
  poses = follow(scans);
  expect_all_finite(poses);
  EXPECT_LT(off_m(truth.front(), truth.back(), poses.back()), 0.05);
}

TEST(DirectOdometry, GoesOnFromWhereItIsSetDownAgain) {
  const auto truth = curve(50);
  std::vector<maps::Scan> scans = scans_from(test::street(43), truth);
  // Carried elsewhere between two scans; from there on another street is seen.
  const std::vector<maps::Scan> elsewhere = scans_from(test::street(78), truth);
  constexpr std::size_t kCarried = 20, kAgain = kCarried + 10;
  std::copy(elsewhere.begin() + kCarried, elsewhere.end(), scans.begin() + kCarried);
  const auto poses = follow(scans);
  expect_all_finite(poses);
  for (std::size_t i = kAgain; i < poses.size(); ++i) {
    EXPECT_EQ(poses[i].status, OdometryStatus::kMatched) << i;
    const Eigen::Isometry3d T_again = poses[kAgain].T_odom_lidar * truth[kAgain].inverse();
    EXPECT_LT(((T_again * truth[i]).inverse() * poses[i].T_odom_lidar).translation().norm(), 0.15)
        << i;
  }
}

TEST(DirectOdometry, StampsAloneDoNotMoveTheSensor) {
  const auto truth = curve(30);
  const std::vector<maps::Scan> regular = scans_from(test::street(43), truth);
  const auto expect_followed = [&](const std::vector<maps::Scan>& scans) {
    const auto poses = follow(scans);
    for (std::size_t i = 0; i < poses.size(); ++i)
      EXPECT_LT(off_m(truth.front(), truth[i], poses[i]), 0.05) << i;
  };
  // Two scans arrive at once, a millisecond and a nanosecond apart; then the clock is put forward.
  for (const std::int64_t apart_ns : {1'000'000, 1}) {
    std::vector<maps::Scan> burst = regular;
    burst[15].stamp_ns = burst[14].stamp_ns + apart_ns;
    expect_followed(burst);
  }
  std::vector<maps::Scan> jump = regular;
  for (std::size_t i = 15; i < jump.size(); ++i) jump[i].stamp_ns += 3'600'000'000'000;
  expect_followed(jump);
}

TEST(DirectOdometry, NothingButEmptyScansStandsStill) {
  std::vector<maps::Scan> scans;
  for (std::size_t i = 0; i < 5; ++i) scans.push_back(scan_of({}, i));
  for (const OdometryPose& pose : follow(scans)) {
    EXPECT_EQ(pose.status, OdometryStatus::kPredicted);
    EXPECT_TRUE(pose.T_odom_lidar.isApprox(Eigen::Isometry3d::Identity()));
    EXPECT_TRUE(pose.covariance.allFinite());
  }
}

TEST(DirectOdometry, RefusesAStampThatDoesNotIncrease) {
  const auto odometry = make_odometry("default");
  (void)odometry->add(*odometry->prepare(scan_of({}, 3)));
  EXPECT_THROW((void)odometry->add(*odometry->prepare(scan_of({}, 3))), std::invalid_argument);
}

/// One turn of the sensor in 0.1 s while it moves with a constant twist.
maps::PointCloud rolling_sweep(const test::SyntheticWorld& world, const Eigen::Isometry3d& T_stamp,
                               const Vector6d& twist) {
  maps::PointCloud cloud;
  for (int column = 0; column < 360; ++column) {
    const double t = 0.1 * column / 360.0 - 0.05;
    const double azimuth = std::numbers::pi - 2.0 * std::numbers::pi * column / 360.0;
    const Eigen::Isometry3d T = T_stamp * maps::exp_se3(twist * t);
    for (int ring = 0; ring < 20; ++ring) {
      const double elevation = -0.43 + 0.53 * ring / 19.0;
      const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                      std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      const double range = world.cast(T.translation(), T.linear() * direction);
      if (!(range < 70.0)) continue;
      cloud.positions.push_back((range * direction).cast<float>());
      cloud.time_offsets_s.push_back(static_cast<float>(t));
    }
  }
  return cloud;
}

TEST(DirectOdometry, TakesTheMotionOutOfRollingSweeps) {
  const test::SyntheticWorld world = test::street(44, 200.0);
  Vector6d twist;
  twist << 12.0, 0.1, 0.0, 0.0, 0.02, 0.05;
  std::vector<maps::Scan> timed, untimed;
  std::vector<Eigen::Isometry3d> truth;
  for (std::size_t i = 0; i < 25; ++i) {
    truth.push_back(pose_at(20.0, 0.0) * maps::exp_se3(twist * (0.1 * static_cast<double>(i))));
    timed.push_back(scan_of(rolling_sweep(world, truth.back(), twist), i));
    untimed.push_back(timed.back());
    untimed.back().cloud.time_offsets_s.clear();
  }
  const auto poses = follow(timed);
  const double off = off_m(truth.front(), truth.back(), poses.back());
  EXPECT_LT(off, 0.06);
  EXPECT_LT(off, off_m(truth.front(), truth.back(), follow(untimed).back()));
  EXPECT_LT((poses.back().twist_lidar - twist).norm(), 0.15);
}

TEST(RunOdometry, SameBitsForAnyNumberOfThreadsAndInOrder) {
  const auto truth = curve(12);
  const std::vector<maps::Scan> scans = scans_from(test::street(45), truth);
  maps::Drive::Contents contents;
  for (const maps::Scan& scan : scans) {
    contents.scan_files.emplace_back(scan.source);
    contents.stamps_ns.push_back(scan.stamp_ns);
  }
  const maps::Drive drive(contents);
  const auto run = [&](int threads) {
    std::vector<std::size_t> order;
    const FollowedDrive followed{
        .drive = drive,
        .begin = 2,
        .end = 12,
        .read = [&](std::size_t i) { return scans[i]; },
        .take = [&](std::size_t i, const maps::Scan&, const OdometryPose&) { order.push_back(i); }};
    std::vector<OdometryPose> poses = run_odometry(followed, threads, {}, CancelFlag{false});
    EXPECT_THAT(order, ElementsAre(2, 3, 4, 5, 6, 7, 8, 9, 10, 11));
    return poses;
  };
  const auto one = run(1), four = run(4);
  ASSERT_EQ(one.size(), four.size());
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].T_odom_lidar.matrix(), four[i].T_odom_lidar.matrix());
    EXPECT_EQ(one[i].covariance, four[i].covariance);
  }
  EXPECT_THROW((void)run_odometry({drive, 5, 13}, 1, {}, CancelFlag{false}), std::invalid_argument);
  EXPECT_THROW((void)run_odometry({drive, 0, 3}, 1, {}, CancelFlag{true}), Cancelled);
}

}  // namespace direct_odometry_test
}  // namespace stillmap::mapping
