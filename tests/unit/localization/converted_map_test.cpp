// A map of schema 1 and the same in schema 2: scans are found in both alike.
#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/convert_package.hpp>
#include <stillmap/maps/map_package.hpp>

#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>
#include <support/temporary_folder.hpp>

#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace stillmap::localization {
namespace converted_map_test {

using test::pose_at;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.columns = 360;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

class ConvertedMap : public ::testing::Test {
 protected:
  ConvertedMap() {
    std::vector<Eigen::Isometry3d> poses;
    for (double x = 30.0; x <= 90.0; x += 3.0) poses.push_back(pose_at(x, 0.0));
    std::map<maps::TileId, std::vector<maps::MapPoint>> tiles;
    for (const Eigen::Vector3d& p : world_.mapped_from(poses, pattern(50))) {
      const auto tile = [](double c) {
        return static_cast<std::int32_t>(std::floor(c / maps::kTileSizeM));
      };
      tiles[{.level = 0, .x = tile(p.x()), .y = tile(p.y())}].push_back(
          {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), 0.0F, 1,
           maps::PointKind::kMeasured, 0});
    }
    maps::MapPackageWriter writer(folder_.path() / "old", {}, 1);
    for (const auto& [id, points] : tiles) writer.add_tile(id, points);
    std::vector<maps::StampedPose> trajectory;
    for (const Eigen::Isometry3d& T : poses)
      trajectory.push_back({.stamp_ns = static_cast<std::int64_t>(trajectory.size()),
                            .T_map_lidar = Eigen::Translation3d(origin_) * T});
    writer.write_trajectory(maps::Trajectory(std::move(trajectory)));
    maps::MapManifest manifest;
    manifest.frame_id = "map";
    manifest.origin = origin_;
    manifest.voxel_size_m = 0.1;
    manifest.software_version = "0";
    (void)writer.publish(manifest, "{}");
    old_ = maps::MapPackage::open(folder_.path() / "old");
    maps::convert_package(*old_, folder_.path() / "new");
    new_ = maps::MapPackage::open(folder_.path() / "new");
  }

  void expect_alike(const AlignmentResult& before, const AlignmentResult& after) {
    EXPECT_EQ(before.status, after.status);
    EXPECT_EQ(before.reasons, after.reasons);
    // Of a scan that is lost no pose is told.
    if (before.status == PoseStatus::kLost) return;
    const Eigen::Isometry3d T = before.T_map_lidar.inverse() * after.T_map_lidar;
    EXPECT_LT(T.translation().norm(), 1e-3);
    EXPECT_LT(Eigen::AngleAxisd(T.linear()).angle(), 1e-4);
  }

  test::TemporaryFolder folder_;
  test::SyntheticWorld world_ = test::street(31);
  Eigen::Vector3d origin_{5003.0, -3001.5, 40.25};
  std::shared_ptr<const maps::MapPackage> old_, new_;
};

TEST_F(ConvertedMap, AnswersAsBefore) {
  ASSERT_EQ(old_->manifest().schema, 1);
  ASSERT_EQ(new_->manifest().schema, 2);
  const auto before = make_aligner("default", *old_), after = make_aligner("default", *new_);
  std::size_t found = 0;
  for (int i = 0; i < 24; ++i) {
    SCOPED_TRACE(i);
    // From the middle of the street to beyond its end.
    const Eigen::Isometry3d T_map_lidar =
        Eigen::Translation3d(origin_) * pose_at(34.0 + 4.0 * i, i % 3 - 1.0, 0.03 * i);
    const maps::PointCloud scan = world_.scan(Eigen::Translation3d(-origin_) * T_map_lidar,
                                              pattern(100 + static_cast<std::uint64_t>(i)));
    Prior prior;
    prior.T_map_lidar = T_map_lidar * Eigen::Translation3d(0.5, -0.4, 0.0);
    const AlignmentResult one = before->align(scan, prior), other = after->align(scan, prior);
    expect_alike(one, other);
    found += one.status == PoseStatus::kOk ? 1 : 0;
    if (i % 8 == 0)
      expect_alike(before->align(scan, std::nullopt), after->align(scan, std::nullopt));
  }
  EXPECT_GE(found, 12U);
  EXPECT_LT(found, 24U) << "some are beyond the end of the map";
}

}  // namespace converted_map_test
}  // namespace stillmap::localization
