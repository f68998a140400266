#include "loops/loop_check.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/frames.hpp>

#include <cstddef>
#include <numbers>
#include <vector>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace loop_check_test {

using testing::Each;
using testing::ElementsAre;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

constexpr std::size_t kThere = 50;

/// Fifty metres there and back along the other lane, a keyframe a metre; the second of two drives
/// when asked for.
OdometryPath there_and_back(bool two_drives) {
  OdometryPath path;
  const Matrix6d covariance = 1e-5 * Matrix6d::Identity();
  for (std::size_t i = 0; i < kThere; ++i)
    path.append(test::pose_at(static_cast<double>(i), -1.5), covariance, 0);
  for (std::size_t i = 0; i < kThere; ++i)
    path.append(test::pose_at(50.0 - static_cast<double>(i), 1.5, std::numbers::pi), covariance,
                two_drives ? 1 : 0);
  return path;
}

/// The loop that odometry without drift would have, and an error along the street.
Loop loop_between(const OdometryPath& path, std::size_t from, std::size_t to, double error_m) {
  Loop loop;
  loop.from = from;
  loop.to = to;
  loop.T_from_to = path.T_odom_lidar(from).inverse() * path.T_odom_lidar(to);
  loop.T_from_to.translation().x() += error_m;
  loop.covariance = 1e-4 * Matrix6d::Identity();
  return loop;
}

TEST(AgreedLoops, LeaveOutALoneOne) {
  const OdometryPath path = there_and_back(false);
  EXPECT_THAT(agreed_loops({loop_between(path, 10, 90, 0.0)}, path), ElementsAre(0));
  EXPECT_THAT(agreed_loops({}, path), ElementsAre());
}

TEST(AgreedLoops, AreThoseThatNeighboursConfirm) {
  const OdometryPath path = there_and_back(false);
  const std::vector<Loop> loops = {
      loop_between(path, 10, 90, 0.0), loop_between(path, 12, 88, 0.02),
      loop_between(path, 11, 89, 5.0), loop_between(path, 14, 86, 0.0)};
  EXPECT_THAT(agreed_loops(loops, path), ElementsAre(1, 1, 0, 1));
}

TEST(AgreedLoops, AreNotConfirmedFromAfar) {
  const OdometryPath path = there_and_back(false);
  const std::vector<Loop> loops = {loop_between(path, 2, 98, 0.0), loop_between(path, 45, 55, 0.0)};
  EXPECT_THAT(agreed_loops(loops, path), Each(0));
}

TEST(AgreedLoops, NeedMoreBetweenDrives) {
  const OdometryPath path = there_and_back(true);
  std::vector<Loop> loops = {loop_between(path, 10, 90, 0.0), loop_between(path, 12, 88, 0.0)};
  EXPECT_THAT(agreed_loops(loops, path), Each(0));
  loops.push_back(loop_between(path, 14, 86, 0.0));
  EXPECT_THAT(agreed_loops(loops, path), Each(1));
}

TEST(AgreedLoops, MayLeadToOneOdometryFrameFromAnother) {
  // Whatever lies between the frames of two drives: the loops all say the same.
  const OdometryPath path = there_and_back(true);
  std::vector<Loop> loops;
  for (const std::size_t i : {10U, 12U, 14U}) loops.push_back(loop_between(path, i, 100 - i, 0.0));
  OdometryPath moved;
  const Eigen::Isometry3d elsewhere = test::pose_at(400.0, -70.0, 1.0);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Eigen::Isometry3d& T = path.T_odom_lidar(i);
    moved.append(path.drive(i) == 0 ? T : elsewhere * T, 1e-5 * Matrix6d::Identity(),
                 path.drive(i));
  }
  EXPECT_THAT(agreed_loops(loops, moved), Each(1));
}

}  // namespace loop_check_test
}  // namespace stillmap::mapping
