#include "odometry/gravity.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/imu.hpp>

#include <cmath>
#include <memory>
#include <string>

namespace stillmap::mapping {
namespace gravity_test {

constexpr double kG = 9.81;
const Eigen::Vector3d kUp = Eigen::Vector3d(0.2, -0.1, 1.0).normalized();

/// In a frame of odometry that is tilted: a way that speeds up and turns, and a hand that looks
/// around.
Eigen::Isometry3d T_odom_lidar(double time_s, double turns) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(0.2 * time_s * time_s, std::sin(0.8 * time_s), 0.0);
  T.linear() = maps::exp_so3(turns * Eigen::Vector3d(0.2 * std::sin(1.1 * time_s),
                                                     0.2 * std::sin(1.7 * time_s), 0.8 * time_s));
  return T;
}

struct Followed {
  maps::Drive drive;
  std::vector<OdometryPose> poses;
};

Followed followed(double turns, const Eigen::Vector3d& force_bias, double gravity = kG) {
  constexpr double kH = 1e-3;
  std::vector<maps::ImuReading> readings;
  for (int i = 0; i < 6000; ++i) {
    const double t = 0.005 * i;
    const Eigen::Vector3d acceleration =
        (T_odom_lidar(t + kH, turns).translation() - 2.0 * T_odom_lidar(t, turns).translation() +
         T_odom_lidar(t - kH, turns).translation()) /
        (kH * kH);
    const Eigen::Vector3d force =
        T_odom_lidar(t, turns).linear().transpose() * (acceleration + gravity * kUp) + force_bias;
    readings.push_back({std::llround(1e9 * t), Eigen::Vector3f::Zero(), force.cast<float>()});
  }
  maps::Imu imu;
  imu.source = "/imu";
  imu.readings = std::make_shared<const std::vector<maps::ImuReading>>(std::move(readings));
  imu.fit = maps::Imu::Fit{};
  maps::Drive::Contents contents;
  contents.imu = std::make_shared<const maps::Imu>(std::move(imu));
  std::vector<OdometryPose> poses;
  for (int i = 0; i < 290; ++i) {
    contents.scan_files.emplace_back("scan.bin");
    contents.stamps_ns.push_back(100'000'000LL * i);
    poses.emplace_back().status = OdometryStatus::kMatched;
    poses.back().T_odom_lidar = T_odom_lidar(0.1 * i, turns);
  }
  return {maps::Drive(std::move(contents)), std::move(poses)};
}

double off_deg(const Eigen::Vector3d& up) {
  return std::acos(std::min(1.0, up.dot(kUp))) * 180.0 / M_PI;
}

TEST(Gravity, IsUpwardWhileTheSensorSpeedsUp) {
  const Followed drive = followed(0.0, Eigen::Vector3d::Zero());
  const auto up = up_in_odom(drive.drive, 0, drive.poses).up_odom;
  ASSERT_TRUE(up);
  EXPECT_LT(off_deg(*up), 0.1);
}

TEST(Gravity, FindsTheBiasWhereTheSensorTurns) {
  const Eigen::Vector3d bias(0.1, -0.1, 0.05);
  const Followed turning = followed(1.0, bias);
  EXPECT_LT(off_deg(up_in_odom(turning.drive, 0, turning.poses).up_odom.value()), 0.15);
  const Followed straight = followed(0.0, bias);
  EXPECT_GT(off_deg(up_in_odom(straight.drive, 0, straight.poses).up_odom.value()), 0.3);
}

TEST(Gravity, IsNotToldByOtherForces) {
  const Followed weak = followed(0.5, Eigen::Vector3d::Zero(), 1.0);
  const Vertical none = up_in_odom(weak.drive, 0, weak.poses);
  EXPECT_FALSE(none.up_odom);
  EXPECT_THAT(none.fault, testing::HasSubstr("a mean force of 1.0"));
  const Followed drive = followed(0.5, Eigen::Vector3d::Zero());
  const Vertical without = up_in_odom(drive.drive.with_imu(nullptr), 0, drive.poses);
  EXPECT_FALSE(without.up_odom);
  EXPECT_EQ(without.fault, "");
  const Vertical few = up_in_odom(drive.drive, 0, std::span(drive.poses).first(8));
  EXPECT_FALSE(few.up_odom);
  EXPECT_THAT(few.fault, testing::HasSubstr("fewer than 10 scans"));
}

TEST(Gravity, ABlowDoesNotTiltIt) {
  Followed drive = followed(0.5, Eigen::Vector3d::Zero());
  auto imu = std::make_shared<maps::Imu>(*drive.drive.contents().imu);
  std::vector<maps::ImuReading> readings = *imu->readings;
  readings[1003].force_mps2.x() = 3534.0F;
  imu->readings = std::make_shared<const std::vector<maps::ImuReading>>(std::move(readings));
  const auto up = up_in_odom(drive.drive.with_imu(imu), 0, drive.poses).up_odom;
  ASSERT_TRUE(up);
  EXPECT_LT(off_deg(*up), 0.1);
}

/// z of the frame of the ground in the frame of odometry, once that is levelled.
Eigen::Vector3d levelled_up(const Vertical& vertical, bool ground_is_seen, std::string& note) {
  Eigen::Isometry3d T_ground_odom = Eigen::Isometry3d::Identity();
  note = level(vertical, ground_is_seen, T_ground_odom);
  return T_ground_odom.linear().transpose() * Eigen::Vector3d::UnitZ();
}

TEST(Gravity, LevelsTheGroundUnlessTheyDisagree) {
  std::string note;
  EXPECT_LT(off_deg(levelled_up({kUp, {}}, true, note)), 1e-4);
  EXPECT_THAT(note, testing::HasSubstr("from the accelerometer, 12.6 deg from the ground's"));
  // Of the other sign: the map would be upside down.
  EXPECT_EQ(levelled_up({Eigen::Vector3d(-kUp), {}}, true, note), Eigen::Vector3d::UnitZ());
  EXPECT_THAT(note, testing::HasSubstr("from the ground, as that of the accelerometer is 167 deg"));
  // Without ground it is all that there is.
  EXPECT_LT(off_deg(levelled_up({kUp, {}}, false, note)), 1e-4);
  EXPECT_EQ(levelled_up({{}, "a reason"}, true, note), Eigen::Vector3d::UnitZ());
  EXPECT_THAT(note, testing::HasSubstr("shows a reason"));
  EXPECT_EQ(levelled_up({}, true, note), Eigen::Vector3d::UnitZ());
  EXPECT_EQ(note, "");
}

}  // namespace gravity_test
}  // namespace stillmap::mapping
