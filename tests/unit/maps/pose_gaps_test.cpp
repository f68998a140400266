#include "drives/pose_gaps.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <utility>
#include <vector>

namespace stillmap::maps {
namespace pose_gaps_test {

using ::testing::ElementsAre;
using Place = PoseGaps::Place;

std::int64_t at_s(double seconds) { return std::llround(seconds * 1e9); }

/// Poses every 0.1 s for 10 s, but for those from 4 s to `end_s`.
Trajectory path_with_gap(double end_s,
                         const std::function<Eigen::Isometry3d(double time_s)>& pose_at) {
  std::vector<StampedPose> poses;
  for (int i = 0; i <= 100; ++i) {
    const double time_s = 0.1 * i;
    if (time_s > 4.05 && time_s < end_s - 0.05) continue;
    poses.push_back({.stamp_ns = at_s(time_s), .T_map_lidar = pose_at(time_s)});
  }
  return Trajectory(std::move(poses));
}

Eigen::Isometry3d ahead(double x_m) {
  return Eigen::Isometry3d(Eigen::Translation3d(x_m, 0.0, 0.0));
}

Eigen::Isometry3d turned(double rad) {
  return Eigen::Isometry3d(Eigen::AngleAxisd(rad, Eigen::Vector3d::UnitZ()));
}

TEST(PoseGaps, OfAMovingSensorHaveNoPlaces) {
  const Trajectory path = path_with_gap(6.0, [](double time_s) { return ahead(5.0 * time_s); });
  const PoseGaps gaps(path);
  EXPECT_EQ(gaps.of(at_s(3.95)), Place::kKnown);
  EXPECT_EQ(gaps.of(at_s(4.0)), Place::kKnown);
  EXPECT_EQ(gaps.of(at_s(4.05)), Place::kUnknown);
  EXPECT_EQ(gaps.of(at_s(5.95)), Place::kUnknown);
  EXPECT_EQ(gaps.of(at_s(6.0)), Place::kKnown);
  EXPECT_EQ(gaps.of(at_s(11.0)), Place::kKnown) << "behind the end: Trajectory::at says what is";
}

TEST(PoseGaps, OfASecondAreBridged) {
  const Trajectory path = path_with_gap(5.0, [](double time_s) { return ahead(5.0 * time_s); });
  EXPECT_EQ(PoseGaps(path).of(at_s(4.5)), Place::kKnown);
}

TEST(PoseGaps, OfASensorThatTurnsInPlaceHaveNoPlaces) {
  const Trajectory path = path_with_gap(6.0, [](double time_s) { return turned(0.1 * time_s); });
  EXPECT_EQ(PoseGaps(path).of(at_s(5.0)), Place::kUnknown);
}

TEST(PoseGaps, OfASensorThatStoodStillAreBridged) {
  const Trajectory path = path_with_gap(9.0, [](double time_s) { return ahead(0.01 * time_s); });
  EXPECT_EQ(PoseGaps(path).of(at_s(5.0)), Place::kBridged);
}

TEST(PoseGaps, AsWideAsAllOthersAreBridged) {
  std::vector<StampedPose> poses;
  for (int i = 0; i < 10; ++i)
    poses.push_back({.stamp_ns = at_s(2.0 * i), .T_map_lidar = ahead(10.0 * i)});
  const Trajectory path(poses);
  EXPECT_EQ(PoseGaps(path).of(at_s(5.0)), Place::kBridged);
  EXPECT_EQ(PoseGaps(path).of(at_s(6.0)), Place::kKnown);
}

TEST(PoseGaps, OfPathsWithoutTwoPosesAreNone) {
  const Trajectory none;
  EXPECT_EQ(PoseGaps(none).of(at_s(1.0)), Place::kKnown);
  const Trajectory one({{.stamp_ns = 0, .T_map_lidar = ahead(0.0)}});
  EXPECT_EQ(PoseGaps(one).of(at_s(1.0)), Place::kKnown);
}

TEST(ScansInGaps, AreSaidByWhatBecomesOfThem) {
  ScansInGaps scans;
  EXPECT_TRUE(scans.add(Place::kKnown));
  EXPECT_TRUE(scans.add(Place::kBridged));
  EXPECT_FALSE(scans.add(Place::kUnknown));
  EXPECT_FALSE(scans.add(Place::kUnknown));
  Drive::Contents contents;
  scans.note(contents, "/odom");
  EXPECT_THAT(contents.notes,
              ElementsAre("2 scans left out, which lie in gaps of over 1 s between poses of /odom "
                          "while the sensor moved; to keep them, give poses without gaps",
                          "1 scans lie in gaps of over 1 s between poses of /odom, and are placed "
                          "on a straight line across them"));
}

}  // namespace pose_gaps_test
}  // namespace stillmap::maps
