#include "reference/pcl_icp.hpp"

#include <stillmap/mapping/reference.hpp>

#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>
#include <support/temporary_folder.hpp>

#include <array>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

namespace stillmap::mapping {
namespace pcl_icp_test {

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

/// A package of one tile that holds a room.
std::shared_ptr<const maps::MapPackage> room_package(const test::TemporaryFolder& folder,
                                                     const Eigen::Vector3d& origin) {
  std::vector<maps::MapPoint> points;
  for (const Eigen::Vector3d& p : room().world.mapped_from(
           {pose_at(-5, 0), pose_at(0, 0), pose_at(5, 0), pose_at(0, -5)}, {})) {
    const Eigen::Vector3f q = (p + Eigen::Vector3d(20.0, 20.0, 0.0)).cast<float>();
    points.push_back({.x = q.x(),
                      .y = q.y(),
                      .z = q.z(),
                      .intensity = 0.5F,
                      .observations = 1,
                      .kind = maps::PointKind::kMeasured,
                      .object = 0});
  }
  // Of schema 1, which has coarser levels.
  maps::MapPackageWriter writer(folder.path() / "room", {}, 1);
  writer.add_tile({2, 0, 0}, points);
  writer.add_tile({0, 0, 0}, points);
  writer.write_trajectory(maps::Trajectory({{0, pose_at(20.0, 20.0)}}));
  maps::MapManifest manifest;
  manifest.frame_id = "map";
  manifest.origin = origin;
  manifest.voxel_size_m = 0.1;
  writer.publish(manifest, "{}");
  return maps::MapPackage::open(folder.path() / "room");
}

TEST(MapAligner, OurIcpAndPclsLandAtTheSamePose) {
  const test::TemporaryFolder folder;
  const Eigen::Vector3d origin(1000.0, -2000.0, 50.0);
  const auto package = room_package(folder, origin);
  const auto ours = make_map_aligner("icp", *package);
  const auto pcls = make_map_aligner("pcl-icp", *package);
  Eigen::Isometry3d T_map_room = Eigen::Isometry3d::Identity();
  T_map_room.translation() = origin + Eigen::Vector3d(20.0, 20.0, 0.0);
  for (const auto& [x, y, yaw] :
       std::vector<std::array<double, 3>>{{0.3, -0.2, 0.03}, {-0.8, 0.5, -0.05}, {1.0, 1.0, 0.1}}) {
    const Eigen::Isometry3d T_room_lidar = pose_at(1.0, 0.5, 0.2);
    const maps::PointCloud scan = room().world.scan(T_room_lidar, {});
    const localization::Prior prior{T_map_room * pose_at(1.0 + x, 0.5 + y, 0.2 + yaw),
                                    std::nullopt};
    const Eigen::Isometry3d T_ours = ours->align(scan, prior).T_map_lidar;
    const Eigen::Isometry3d difference = T_ours.inverse() * pcls->align(scan, prior).T_map_lidar;
    EXPECT_LT(difference.translation().norm(), 0.002) << "from " << x << " " << y;
    EXPECT_LT(maps::rotation_angle_rad(difference.linear()), 2e-4) << "from " << x << " " << y;
    EXPECT_LT(((T_map_room * T_room_lidar).inverse() * T_ours).translation().norm(), 0.05);
  }
}

}  // namespace pcl_icp_test
}  // namespace stillmap::mapping
