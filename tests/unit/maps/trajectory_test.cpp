#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include <stillmap/maps/text.hpp>
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace trajectory_test {

using test::IsNearPose;
using test::TemporaryFolder;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Optional;
using ::testing::ThrowsMessage;

constexpr std::int64_t kSecond = 1'000'000'000;

Eigen::Isometry3d pose(double x, double yaw_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T.translation().x() = x;
  return T;
}

Trajectory two_poses() { return Trajectory({{0, pose(0, 0)}, {kSecond, pose(10, 1.0)}}); }

TEST(Trajectory, GivesItsOwnPosesExactly) {
  EXPECT_EQ(two_poses().at(kSecond).value().matrix(), pose(10, 1.0).matrix());
}

TEST(Trajectory, InterpolatesPlaceAndHeadingLinearly) {
  EXPECT_THAT(two_poses().at(kSecond / 4), Optional(IsNearPose(pose(2.5, 0.25), 1e-12, 1e-12)));
}

TEST(Trajectory, TakesTheShortWayRound) {
  const double pi = std::numbers::pi;
  const Trajectory trajectory({{0, pose(0, pi - 0.1)}, {kSecond, pose(0, -pi + 0.1)}});
  EXPECT_THAT(trajectory.at(kSecond / 2), Optional(IsNearPose(pose(0, pi), 1e-12, 1e-12)));
}

TEST(Trajectory, ContinuesAtConstantVelocityUpToTheLimit) {
  const Trajectory trajectory = two_poses();
  EXPECT_THAT(trajectory.at(-kSecond / 10), Optional(IsNearPose(pose(-1, -0.1), 1e-12, 1e-12)));
  EXPECT_THAT(trajectory.at(kSecond + kSecond / 5),
              Optional(IsNearPose(pose(12, 1.2), 1e-12, 1e-12)));
  EXPECT_FALSE(trajectory.at(-kSecond / 5 - 1));
  EXPECT_FALSE(trajectory.at(kSecond + kSecond / 5 + 1));
  EXPECT_FALSE(trajectory.at(kSecond + 1, 0.0));
  EXPECT_TRUE(trajectory.at(3 * kSecond, 2.0));
}

TEST(Trajectory, WithOnePoseKnowsOnlyThatInstant) {
  const Trajectory trajectory({{5, pose(1, 0)}});
  EXPECT_TRUE(trajectory.at(5));
  EXPECT_FALSE(trajectory.at(6));
  EXPECT_FALSE(Trajectory().at(0));
}

TEST(Trajectory, HoldsForStampsAtTheEndsOfTheirRange) {
  using Limits = std::numeric_limits<std::int64_t>;
  const Trajectory trajectory({{Limits::min(), pose(0, 0)}, {Limits::max(), pose(2, 0)}});
  EXPECT_THAT(trajectory.at(0), Optional(IsNearPose(pose(1, 0), 1e-9, 1e-9)));
}

TEST(Trajectory, RefusesUnorderedStampsAndPosesThatAreNotFinite) {
  EXPECT_THROW(Trajectory({{1, pose(0, 0)}, {1, pose(1, 0)}}), std::invalid_argument);
  EXPECT_THROW(Trajectory({{1, pose(std::nan(""), 0)}}), std::invalid_argument);
  EXPECT_THROW((void)two_poses().at(0, std::nan("")), std::invalid_argument);
  EXPECT_THROW((void)two_poses().at(0, -0.1), std::invalid_argument);
}

TEST(StampText, IsParsedWithoutLoss) {
  EXPECT_EQ(parse_stamp_ns("1317042651.158069617"), 1317042651158069617);
  EXPECT_EQ(parse_stamp_ns("1577836980.0991046"), 1577836980099104600);
  EXPECT_EQ(parse_stamp_ns("0"), 0);
  EXPECT_EQ(parse_stamp_ns("-0.5"), -500'000'000);
  EXPECT_EQ(parse_stamp_ns("+1."), kSecond);
  EXPECT_EQ(parse_stamp_ns(".25"), 250'000'000);
  EXPECT_EQ(parse_stamp_ns("1.037359e-01"), 103'735'900);
  EXPECT_EQ(parse_stamp_ns("1.3170426511580696170e+09"), 1317042651158069617);
  EXPECT_EQ(parse_stamp_ns("000000000000000000000001"), kSecond);
}

TEST(StampText, RoundsBeyondTheNinthDecimal) {
  EXPECT_EQ(parse_stamp_ns("1.0000000004999"), kSecond);
  EXPECT_EQ(parse_stamp_ns("1.0000000005"), kSecond + 1);
  EXPECT_EQ(parse_stamp_ns("0.9999999996"), kSecond);
  EXPECT_EQ(parse_stamp_ns("5e-10"), 1);
  EXPECT_EQ(parse_stamp_ns("4e-10"), 0);
  EXPECT_EQ(parse_stamp_ns("9e-11"), 0);
}

TEST(StampText, RefusesWhatIsNoStampInRange) {
  for (const char* text : {"", "-", ".", "nan", "inf", "1e", "1e+", "1.2.3", "1x", "0x10", "1e19",
                           "9223372037", "1e999999999999", " 1"}) {
    EXPECT_FALSE(parse_stamp_ns(text)) << text;
  }
}

TEST(SecondsBetween, CountsAnyTwoStamps) {
  using Limits = std::numeric_limits<std::int64_t>;
  EXPECT_DOUBLE_EQ(seconds_between(1'300'000'000'000'000'000, 1'300'000'000'100'000'000), 0.1);
  EXPECT_DOUBLE_EQ(seconds_between(100, 0), -1e-7);
  EXPECT_NEAR(seconds_between(Limits::min(), Limits::max()), 0x1p64 * 1e-9, 1.0);
}

TEST(KittiPoses, AreReadRowByRow) {
  const TemporaryFolder folder;
  const auto file =
      folder.write("poses.txt", "1 0 0 1 0 1 0 2 0 0 1 3\n0 -1 0 4 1 0 0 5 0 0 1 6\r\n\n");
  const std::vector<Eigen::Isometry3d> poses = read_kitti_poses(file);
  ASSERT_EQ(poses.size(), 2U);
  EXPECT_EQ(poses[0].translation(), Eigen::Vector3d(1, 2, 3));
  Eigen::Isometry3d turned = pose(4, 0.5 * std::numbers::pi);
  turned.translation() << 4, 5, 6;
  EXPECT_THAT(poses[1], IsNearPose(turned, 1e-15, 1e-15));
}

TEST(KittiPoses, AreBroughtBackIntoSo3) {
  const TemporaryFolder folder;
  const auto file = folder.write("p.txt", "0.9998 0 0 0 0 1.0001 0 0 0 0 1 0\n");
  EXPECT_LT((read_kitti_poses(file)[0].linear() - Eigen::Matrix3d::Identity()).norm(), 1e-15);
}

void expect_kitti_error(const std::string& text, const std::string& where,
                        const std::string& what) {
  const TemporaryFolder folder;
  const auto file = folder.write("poses.txt", text);
  EXPECT_THAT([&] { (void)read_kitti_poses(file); },
              ThrowsMessage<InputError>(AllOf(HasSubstr("poses.txt " + where), HasSubstr(what))))
      << text;
}

TEST(KittiPoses, NameLineAndValueOfWhatIsWrong) {
  const std::string good = "1 0 0 1 0 1 0 2 0 0 1 3\n";
  expect_kitti_error(good + "1 0 0 1 0 1 0 2 0 0 1\n", "line 2", "11 fields");
  expect_kitti_error("1 0 0 1 0 1 0 2 0 0 1 x\n", "line 1", "'x'");
  expect_kitti_error("1 0 0 nan 0 1 0 2 0 0 1 3\n", "line 1", "'nan'");
  expect_kitti_error("1 0 0 1 0 1 0 2 0 0 1.1 3\n", "line 1", "rotation");
  expect_kitti_error("1 0 0 1 0 1 0 2 0 0 -1 3\n", "line 1", "rotation");
  expect_kitti_error("0 0 0 1 0 0 0 2 0 0 0 3\n", "line 1", "rotation");
  expect_kitti_error(good + "\n" + good, "line 2", "blank");
  expect_kitti_error("1 0 0 1 0 1 0 -2e9 0 0 1 3\n", "line 1", "a position of 2e+09 m");
}

TEST(KittiPoses, OfAMissingFileAreAStorageError) {
  EXPECT_THAT([] { (void)read_kitti_poses("/nowhere/poses.txt"); },
              ThrowsMessage<StorageError>(
                  AllOf(HasSubstr("/nowhere/poses.txt"), HasSubstr("No such file"))));
}

TEST(TumTrajectory, SurvivesWritingAndReadingBitForBit) {
  const TemporaryFolder folder;
  std::vector<StampedPose> poses;
  for (int i = 0; i < 20; ++i) {
    Eigen::Matrix<double, 6, 1> twist;
    twist << 1e3 / 3.0 * i, -i / 7.0, 0.1 * i, 0.1 * i, 0.05 * i, -0.07 * i;
    poses.push_back({1317042651158069617 + i * 100'000'001, exp_se3(twist)});
  }
  const Trajectory written{poses};
  write_tum_trajectory(folder.path() / "a.tum", written);
  const Trajectory read = read_tum_trajectory(folder.path() / "a.tum");
  ASSERT_EQ(read.size(), written.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    EXPECT_EQ(read.poses()[i].stamp_ns, poses[i].stamp_ns);
    EXPECT_EQ(read.poses()[i].T_map_lidar.translation(), poses[i].T_map_lidar.translation());
    EXPECT_THAT(read.poses()[i].T_map_lidar, IsNearPose(poses[i].T_map_lidar, 0.0, 1e-15));
  }
}

TEST(TumTrajectory, WritesStampsBeforeTheEpochToo) {
  const TemporaryFolder folder;
  write_tum_trajectory(folder.path() / "a.tum", Trajectory({{-1, pose(0, 0)}, {1, pose(1, 0)}}));
  EXPECT_THAT(read_text(folder.path() / "a.tum"), HasSubstr("-0.000000001 0 0 0"));
  EXPECT_EQ(read_tum_trajectory(folder.path() / "a.tum").poses()[0].stamp_ns, -1);
}

TEST(TumTrajectory, SkipsComments) {
  const TemporaryFolder folder;
  const auto file =
      folder.write("a.tum", "# stamp tx ...\n1 0 0 0 0 0 0 1\n# more\n2 1 0 0 0 0 0 1\n");
  EXPECT_EQ(read_tum_trajectory(file).size(), 2U);
}

void expect_tum_error(const std::string& text, const std::string& where, const std::string& what) {
  const TemporaryFolder folder;
  const auto file = folder.write("a.tum", text);
  EXPECT_THAT([&] { (void)read_tum_trajectory(file); },
              ThrowsMessage<InputError>(
                  AllOf(HasSubstr(where.empty() ? "a.tum" : "a.tum " + where), HasSubstr(what))))
      << text;
}

TEST(TumTrajectory, NamesLineAndValueOfWhatIsWrong) {
  const std::string good = "1 0 0 0 0 0 0 1\n";
  expect_tum_error(good + "1 0 0 0 0 0 0 1\n", "line 2", "stamp '1'");
  expect_tum_error(good + "2 0 0 0 0 0 0\n", "line 2", "7 fields");
  expect_tum_error("1 0 0 0 0 0 0 0\n", "line 1", "norm 0");
  expect_tum_error(good + "2 1e300 0 0 0 0 0 1\n", "line 2", "at most 1e+09 m");
  expect_tum_error("1 0 0 0 0 0 0 inf\n", "line 1", "'inf'");
  expect_tum_error("16242546157 0 0 0 0 0 0 1\n", "line 1", "stamp '16242546157'");
  expect_tum_error("1 0 0 1 0 1 0 2 0 0 1 3\n", "", "in the format kitti");
}

TEST(TumTrajectory, ThatCannotBeWrittenIsAStorageError) {
  EXPECT_THROW(write_tum_trajectory("/nowhere/a.tum", two_poses()), StorageError);
}

}  // namespace trajectory_test
}  // namespace stillmap::maps
