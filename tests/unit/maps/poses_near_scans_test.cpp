#include "bags/poses_near_scans.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace stillmap::maps {
namespace poses_near_scans_test {

StampedPose pose_at(std::int64_t stamp_ns) {
  StampedPose pose{stamp_ns, Eigen::Isometry3d::Identity()};
  const double t = 1e-9 * static_cast<double>(stamp_ns);
  pose.T_map_lidar.translation() << t, t * t, -t;
  pose.T_map_lidar.linear() = Eigen::AngleAxisd(t, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return pose;
}

TEST(PosesNearScans, InterpolateAsAllPosesDo) {
  std::mt19937 random(7);
  std::vector<StampedPose> all;
  for (std::int64_t stamp = 0; stamp < 4'000'000'000; stamp += 1 + random() % 9'000'000)
    all.push_back(pose_at(stamp));
  std::vector<std::int64_t> scans{-150'000'000, all[17].stamp_ns, 4'100'000'000};
  for (int i = 0; i < 30; ++i) scans.push_back(random() % 4'000'000'000);
  scans.push_back(scans.back());
  const Trajectory whole(all);
  std::shuffle(all.begin(), all.end(), random);
  PosesNearScans near(scans);
  for (const StampedPose& pose : all) near.add(pose.stamp_ns, pose.T_map_lidar);
  const Trajectory kept = near.trajectory();
  EXPECT_LE(kept.size(), 2 * (scans.size() + 1) + 4);
  EXPECT_LT(kept.size(), all.size() / 4);
  for (const std::int64_t stamp : scans) {
    ASSERT_TRUE(whole.at(stamp)) << stamp;
    EXPECT_EQ(kept.at(stamp)->matrix(), whole.at(stamp)->matrix()) << stamp;
  }
}

TEST(PosesNearScans, OfEqualStampsTheFirstCounts) {
  PosesNearScans near({5});
  near.add(5, pose_at(1'000'000'000).T_map_lidar);
  near.add(5, pose_at(2'000'000'000).T_map_lidar);
  EXPECT_EQ(near.added(), 2U);
  EXPECT_EQ(near.trajectory().size(), 1U);
  EXPECT_EQ(near.trajectory().at(5)->translation().x(), 1.0);
}

TEST(PosesNearScans, MayBeNone) {
  EXPECT_TRUE(PosesNearScans({1, 2}).trajectory().empty());
  EXPECT_TRUE(PosesNearScans({}).trajectory().empty());
}

}  // namespace poses_near_scans_test
}  // namespace stillmap::maps
