#include "pose_graph/corrections.hpp"

#include "support/matchers.hpp"
#include "support/throws.hpp"

#include <stillmap/maps/frames.hpp>

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

namespace stillmap::mapping {
namespace {

using test::IsNearPose;
using test::ThrowsSaying;

Eigen::Isometry3d moved(double tx, double ty, double tz, double rx, double ry, double rz) {
  Eigen::Matrix<double, 6, 1> twist;
  twist << tx, ty, tz, rx, ry, rz;
  return maps::exp_se3(twist);
}

/// A curve of ten scans that gets faster.
std::vector<Eigen::Isometry3d> curve() {
  std::vector<Eigen::Isometry3d> out{moved(5, 6, 1, 0.1, 0.2, 0.3)};
  for (int i = 1; i < 10; ++i) out.push_back(out.back() * moved(0.2 * i, 0, 0, 0, 0.01, 0.05 * i));
  return out;
}

TEST(Corrections, OneMotionOfAllKeyframesMovesEveryScan) {
  const auto odometry = curve();
  const Eigen::Isometry3d T_map_odom = moved(400, -30, 2, 0.4, -1.0, 2.0);
  const auto out = corrected_poses(
      odometry, {2, 5, 7},
      {T_map_odom * odometry[2], T_map_odom * odometry[5], T_map_odom * odometry[7]});
  ASSERT_EQ(out.size(), odometry.size());
  for (std::size_t i = 0; i < out.size(); ++i)
    EXPECT_THAT(out[i], IsNearPose(T_map_odom * odometry[i], 1e-9, 1e-9)) << i;
}

TEST(Corrections, KeyframesAreExact) {
  const auto odometry = curve();
  const std::vector<Eigen::Isometry3d> keys{odometry[0] * moved(1, 0, 0, 0, 0, 0.1),
                                            odometry[4] * moved(0, 2, 0, 0.1, 0, 0),
                                            odometry[9] * moved(0, 0, 3, 0, 0.1, 0)};
  const auto out = corrected_poses(odometry, {0, 4, 9}, keys);
  EXPECT_EQ(out[0].matrix(), keys[0].matrix());
  EXPECT_EQ(out[4].matrix(), keys[1].matrix());
  EXPECT_EQ(out[9].matrix(), keys[2].matrix());
}

TEST(Corrections, BetweenKeyframesTheCorrectionGrowsWithTheWay) {
  std::vector<Eigen::Isometry3d> odometry;
  for (const double x : {0.0, 1.0, 4.0, 10.0}) odometry.push_back(moved(x, 0, 0, 0, 0, 0));
  const auto out = corrected_poses(odometry, {0, 3}, {odometry[0], moved(10, 2, 0, 0, 0, 0)});
  EXPECT_THAT(out[1], IsNearPose(moved(1, 0.2, 0, 0, 0, 0), 1e-12, 1e-12));
  EXPECT_THAT(out[2], IsNearPose(moved(4, 0.8, 0, 0, 0, 0), 1e-12, 1e-12));
}

TEST(Corrections, WhereNothingMovedTheCorrectionGrowsWithTheScans) {
  const std::vector<Eigen::Isometry3d> odometry(5, moved(7, 0, 0, 0, 0, 1));
  const auto out =
      corrected_poses(odometry, {0, 4}, {odometry[0], odometry[0] * moved(0, 0, 0, 0, 0, 0.4)});
  EXPECT_THAT(out[1], IsNearPose(moved(7, 0, 0, 0, 0, 1) * moved(0, 0, 0, 0, 0, 0.1), 1e-9, 1e-9));
}

TEST(Corrections, EndsFollowTheNearestKeyframe) {
  const auto odometry = curve();
  const Eigen::Isometry3d T = moved(1, 2, 3, 0, 0, 0.2);
  const auto out = corrected_poses(odometry, {3}, {T});
  EXPECT_THAT(out[0], IsNearPose(T * odometry[3].inverse() * odometry[0], 1e-9, 1e-9));
  EXPECT_THAT(out[9], IsNearPose(T * odometry[3].inverse() * odometry[9], 1e-9, 1e-9));
}

TEST(Corrections, FarFromTheOriginNothingIsLost) {
  // Of a map in UTM coordinates.
  auto odometry = curve();
  const Eigen::Isometry3d T_far = moved(5e5, 4e6, 0, 0, 0, 0);
  const std::vector<Eigen::Isometry3d> keys{odometry[0],
                                            odometry[9] * moved(0, 0.1, 0, 0, 0, 0.02)};
  const auto near = corrected_poses(odometry, {0, 9}, keys);
  const auto far = corrected_poses(odometry, {0, 9}, {T_far * keys[0], T_far * keys[1]});
  for (std::size_t i = 0; i < near.size(); ++i)
    EXPECT_THAT(far[i], IsNearPose(T_far * near[i], 1e-6, 1e-9));
}

TEST(Corrections, RefusesKeyframesThatDoNotFit) {
  const auto odometry = curve();
  const Eigen::Isometry3d T = odometry[0];
  const auto refused = [&](const std::vector<std::size_t>& keyframes, std::size_t poses,
                           const std::string& text) {
    EXPECT_THAT(
        [&] {
          (void)corrected_poses(odometry, keyframes, std::vector<Eigen::Isometry3d>(poses, T));
        },
        ThrowsSaying<std::invalid_argument>({text}));
  };
  refused({}, 0, "0 keyframes");
  refused({1, 2}, 1, "2 keyframes with 1 poses");
  refused({1, 10}, 2, "keyframe 1 is scan 10 of 10");
  refused({4, 4}, 2, "keyframe 1 is scan 4, after scan 4");
}

}  // namespace
}  // namespace stillmap::mapping
