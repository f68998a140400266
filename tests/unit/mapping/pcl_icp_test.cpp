#include "reference/pcl_icp.hpp"

#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <limits>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

using test::pose_at;

struct Room {
  test::SyntheticWorld world = test::room();
  PclIcpAligner aligner{world.mapped_from({pose_at(-5, 0), pose_at(0, 0), pose_at(5, 0)}, {}), {}};
};
const Room& room() {
  static const Room built;
  return built;
}

TEST(PclIcp, FindsANearbyPoseInARoom) {
  const Eigen::Isometry3d T_map_lidar = pose_at(1.0, 0.5, 0.2);
  const localization::AlignmentResult result =
      room().aligner.align(room().world.scan(T_map_lidar, {}),
                           localization::Prior{pose_at(1.2, 0.4, 0.23), std::nullopt});
  EXPECT_EQ(result.status, localization::PoseStatus::kOk);
  const Eigen::Isometry3d difference = T_map_lidar.inverse() * result.T_map_lidar;
  EXPECT_LT(difference.translation().norm(), 0.1);
  EXPECT_LT(maps::rotation_angle_rad(difference.linear()), 0.01);
  EXPECT_GT(result.inlier_ratio, 0.9);
  EXPECT_TRUE(result.covariance.isZero());
}

TEST(PclIcp, TinyScanIsLostAndBrokenInputIsRefused) {
  maps::PointCloud scan;
  EXPECT_EQ(room().aligner.align(scan, localization::Prior{pose_at(0, 0), std::nullopt}).status,
            localization::PoseStatus::kLost);
  scan.positions.assign(100, Eigen::Vector3f(1.0F, std::numeric_limits<float>::quiet_NaN(), 0.0F));
  EXPECT_THROW((void)room().aligner.align(scan, localization::Prior{pose_at(0, 0), std::nullopt}),
               std::invalid_argument);
  EXPECT_THROW(PclIcpAligner({}, {}), std::invalid_argument);
  PclIcpOptions options;
  options.leaf_m = std::numeric_limits<double>::quiet_NaN();
  options.max_iterations = 0;
  EXPECT_THAT(options.violations(), ::testing::SizeIs(2));
}

}  // namespace
}  // namespace stillmap::mapping
