#include "loops/loop_finder.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::mapping {
namespace loop_finder_test {

using std::numbers::pi;
using testing::IsEmpty;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

struct Driven {
  std::vector<LoopKeyframe> keyframes;
  std::vector<Eigen::Isometry3d> T_world_lidar;
};

/// Out along one lane of a street and back along the other, or out alone, as odometry that turns a
/// little too far has it.
Driven drive(std::uint64_t seed, bool back, std::uint32_t number = 0, double length_m = 60.0) {
  const test::SyntheticWorld world = test::street(seed, length_m + 20.0);
  std::vector<Eigen::Isometry3d> poses;
  for (double x = 10.0; x < 10.0 + length_m; x += 1.5) poses.push_back(test::pose_at(x, -1.5));
  if (back) {
    for (double x = 10.0 + length_m; x > 10.0; x -= 1.5) poses.push_back(test::pose_at(x, 1.5, pi));
  }
  Driven out;
  Eigen::Isometry3d T_odom_lidar = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 1> drift = Eigen::Matrix<double, 6, 1>::Zero();
  drift << 0.004, 0.0, 0.0, 0.0, 0.0, 2e-4;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (i > 0) {
      T_odom_lidar = T_odom_lidar * (poses[i - 1].inverse() * poses[i]) * maps::exp_se3(drift);
    }
    LoopKeyframe keyframe;
    keyframe.points =
        world.scan(poses[i], {.rings = 24, .columns = 360, .noise_m = 0.01, .seed = i + 1})
            .positions;
    keyframe.T_odom_lidar = T_odom_lidar;
    keyframe.covariance = 2e-5 * Matrix6d::Identity();
    keyframe.covariance.bottomRightCorner<3, 3>() *= 1e-2;
    keyframe.drive = number;
    out.keyframes.push_back(std::move(keyframe));
  }
  out.T_world_lidar = poses;
  return out;
}

const Driven& out_and_back() {
  static const Driven driven = drive(5, true);
  return driven;
}

std::vector<Loop> loops_of(const std::vector<LoopKeyframe>& keyframes, int threads = 1) {
  const test::TemporaryFolder folder;
  LoopFinder finder(folder.path());
  for (const LoopKeyframe& keyframe : keyframes) finder.add(keyframe);
  const CancelFlag cancel = false;
  return finder.find(threads, {}, cancel);
}

void expect_right(const std::vector<Loop>& loops, const std::vector<Eigen::Isometry3d>& truth) {
  for (const Loop& loop : loops) {
    const Eigen::Isometry3d error =
        loop.T_from_to.inverse() * truth[loop.from].inverse() * truth[loop.to];
    EXPECT_LT(loop.from, loop.to);
    EXPECT_LT(error.translation().norm(), 0.1) << loop.from << " to " << loop.to;
    EXPECT_LT(maps::rotation_angle_rad(error.linear()), 0.005) << loop.from << " to " << loop.to;
    EXPECT_GT(loop.inlier_ratio, 0.5);
    EXPECT_GT(loop.covariance.ldlt().vectorD().minCoeff(), 0.0);
  }
}

TEST(LoopFinder, FindsTheWayBackAlongTheOtherLane) {
  const Driven& driven = out_and_back();
  const std::vector<Loop> loops = loops_of(driven.keyframes);
  expect_right(loops, driven.T_world_lidar);
  // Of the way back some fifty metres are far enough from the turn; every second keyframe is asked.
  EXPECT_GT(loops.size(), 12U);
  EXPECT_TRUE(std::is_sorted(loops.begin(), loops.end(),
                             [](const Loop& a, const Loop& b) { return a.to < b.to; }));
}

TEST(LoopFinder, GivesTheSameForAnyNumberOfThreads) {
  const std::vector<Loop> one = loops_of(out_and_back().keyframes, 1);
  const std::vector<Loop> four = loops_of(out_and_back().keyframes, 4);
  ASSERT_EQ(one.size(), four.size());
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].from, four[i].from);
    EXPECT_EQ(one[i].to, four[i].to);
    EXPECT_EQ(one[i].T_from_to.matrix(), four[i].T_from_to.matrix());
    EXPECT_EQ(one[i].covariance, four[i].covariance);
  }
}

TEST(LoopFinder, JoinsDrivesWhoseFramesHaveNothingInCommon) {
  const Driven first = drive(5, false, 0, 36.0);
  Driven second = drive(5, false, 3, 36.0);
  for (LoopKeyframe& keyframe : second.keyframes)
    keyframe.T_odom_lidar = test::pose_at(-300.0, 40.0, 2.0) * keyframe.T_odom_lidar;
  Driven both = first;
  both.keyframes.insert(both.keyframes.end(), second.keyframes.begin(), second.keyframes.end());
  both.T_world_lidar.insert(both.T_world_lidar.end(), second.T_world_lidar.begin(),
                            second.T_world_lidar.end());
  const std::vector<Loop> loops = loops_of(both.keyframes);
  expect_right(loops, both.T_world_lidar);
  EXPECT_GT(loops.size(), 7U);
  for (const Loop& loop : loops) {
    EXPECT_LT(loop.from, first.keyframes.size());
    EXPECT_GE(loop.to, first.keyframes.size());
  }
}

TEST(LoopFinder, FindsNoneBetweenDifferentStreets) {
  std::vector<LoopKeyframe> keyframes = drive(5, false, 0, 36.0).keyframes;
  for (LoopKeyframe& keyframe : drive(6, false, 1, 36.0).keyframes)
    keyframes.push_back(std::move(keyframe));
  EXPECT_THAT(loops_of(keyframes), IsEmpty());
}

TEST(LoopFinder, FindsNoneOnAStraightWay) {
  EXPECT_THAT(loops_of(drive(7, false).keyframes), IsEmpty());
}

TEST(LoopFinder, GoesOnWhereNothingIsSeen) {
  std::vector<LoopKeyframe> keyframes = out_and_back().keyframes;
  for (LoopKeyframe& keyframe : keyframes) keyframe.points.clear();
  EXPECT_THAT(loops_of(keyframes), IsEmpty());
  EXPECT_THAT(loops_of({}), IsEmpty());
}

TEST(LoopFinder, RefusesWhatIsNotFiniteAndDrivesOutOfOrder) {
  const test::TemporaryFolder folder;
  LoopFinder finder(folder.path());
  LoopKeyframe keyframe;
  keyframe.drive = 1;
  finder.add(keyframe);
  LoopKeyframe broken = keyframe;
  broken.T_odom_lidar.translation().y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(finder.add(broken), std::invalid_argument);
  broken = keyframe;
  broken.covariance(2, 2) = std::numeric_limits<double>::infinity();
  EXPECT_THROW(finder.add(broken), std::invalid_argument);
  keyframe.drive = 0;
  EXPECT_THROW(finder.add(keyframe), std::invalid_argument);
}

TEST(LoopFinder, EndsWhenItIsCancelled) {
  const test::TemporaryFolder folder;
  LoopFinder finder(folder.path());
  finder.add({});
  const CancelFlag cancel = true;
  EXPECT_THROW(static_cast<void>(finder.find(1, {}, cancel)), Cancelled);
}

}  // namespace loop_finder_test
}  // namespace stillmap::mapping
