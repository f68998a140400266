// Maps are the same wherever their regions lie.
#include "index/index_file.hpp"
#include "index/index_window.hpp"
#include "index/map_level.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/region.hpp>

#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>
#include <support/temporary_folder.hpp>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::localization {
namespace far_maps_test {

namespace fs = std::filesystem;
using test::pose_at;

/// Regions by which the far map lies away: 960 km and 448 km.
constexpr maps::RegionId kFar{1'500, -700};
/// The border of two regions crosses the street [m].
constexpr double kBorderM = maps::kRegionSizeM;
constexpr double kStreetBeginsM = kBorderM - 60.0;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

Eigen::Vector3d corner_m(maps::RegionId region) {
  return maps::kRegionSizeM * Eigen::Vector3d(region.x, region.y, 0.0);
}

/// A pose of the street, where the map has it.
Eigen::Isometry3d placed(Eigen::Isometry3d T, maps::RegionId region) {
  T.translation() += corner_m(region) + Eigen::Vector3d(kStreetBeginsM, 20.0, 0.0);
  return T;
}

class FarMaps : public ::testing::Test {
 protected:
  std::shared_ptr<const maps::MapPackage> map(maps::RegionId region) {
    maps::MapPackageWriter writer(folder_.path() / std::to_string(region.x), {}, 2);
    std::map<maps::TileId, std::vector<maps::MapPoint>> tiles;
    for (const Eigen::Vector3d& p : world_.mapped_from(poses_, pattern(50))) {
      // In steps of a sixteenth of a millimetre, so that moving it rounds nothing.
      const Eigen::Vector3d at =
          placed(Eigen::Isometry3d(Eigen::Translation3d((16384.0 * p).array().round() / 16384.0)),
                 {})
              .translation();
      const auto tile = [](double c) {
        return static_cast<std::int32_t>(std::floor(c / maps::kTileSizeM));
      };
      const maps::TileId id{.level = 0, .x = tile(at.x()), .y = tile(at.y())};
      const Eigen::Vector3d from_corner = at - maps::kTileSizeM * Eigen::Vector3d(id.x, id.y, 0.0);
      tiles[id].push_back(
          maps::moved_to({0.0F, 0.0F, 0.0F, 0.0F, 3, maps::PointKind::kMeasured, 0}, from_corner));
    }
    for (auto& [id, points] : tiles) {
      const maps::TileId moved{.level = 0,
                               .x = id.x + maps::kRegionTiles * region.x,
                               .y = id.y + maps::kRegionTiles * region.y};
      const Eigen::Vector3d corner = maps::kTileSizeM * Eigen::Vector3d(moved.x, moved.y, 0.0);
      writer.add_tile(moved, maps::MapTile(Eigen::Vector3d::Zero(), corner, std::move(points)));
    }
    std::vector<maps::StampedPose> stamped;
    for (const Eigen::Isometry3d& T : poses_)
      stamped.push_back({static_cast<std::int64_t>(stamped.size()), placed(T, region)});
    writer.write_trajectory(maps::Trajectory(std::move(stamped)));
    maps::MapManifest manifest;
    manifest.schema = 2;
    manifest.frame_id = "map";
    manifest.voxel_size_m = 0.1;
    manifest.software_version = "0";
    (void)writer.publish(manifest, "{}");
    return maps::MapPackage::open(folder_.path() / std::to_string(region.x));
  }
  [[nodiscard]] maps::PointCloud scan(const Eigen::Isometry3d& T_street_lidar) const {
    return world_.scan(T_street_lidar, pattern(7));
  }

 private:
  static std::vector<Eigen::Isometry3d> drive() {
    std::vector<Eigen::Isometry3d> poses;
    for (double x = 15.0; x <= 105.0; x += 3.0) poses.push_back(pose_at(x, 0.0));
    return poses;
  }
  test::TemporaryFolder folder_;
  test::SyntheticWorld world_ = test::street(41);
  std::vector<Eigen::Isometry3d> poses_ = drive();
};

std::string bytes_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

TEST_F(FarMaps, HaveTheSameBytesInTheirIndex) {
  const auto near_map = map({});
  const auto far_map = map(kFar);
  const auto index = MapIndex::open(*near_map);
  (void)MapIndex::open(*far_map);
  for (const RegionRow& row : index->root().regions) {
    const std::string near_bytes = bytes_of(region_file_of(near_map->folder(), {}, row.id));
    ASSERT_FALSE(near_bytes.empty());
    EXPECT_EQ(near_bytes, bytes_of(region_file_of(far_map->folder(), {},
                                                  {row.id.x + kFar.x, row.id.y + kFar.y})));
  }
  EXPECT_GE(index->root().regions.size(), 2U);
}

TEST_F(FarMaps, GiveTheSamePosesAlsoAcrossABorderOfRegions) {
  const auto near_aligner = make_aligner("default", *map({}));
  const auto far_aligner = make_aligner("default", *map(kFar));
  for (const double x : {50.0, 59.9, 60.1, 72.0}) {
    const Eigen::Isometry3d T = pose_at(x, 0.4, 0.1);
    for (const bool has_prior : {true, false}) {
      const auto answer = [&](const Aligner& aligner, maps::RegionId region) {
        const Eigen::Isometry3d T_prior = placed(pose_at(x - 0.6, 0.0, 0.05), region);
        return aligner.align(scan(T),
                             has_prior ? std::optional<Prior>({T_prior, {}}) : std::nullopt);
      };
      const AlignmentResult near_answer = answer(*near_aligner, {});
      const AlignmentResult far_answer = answer(*far_aligner, kFar);
      EXPECT_EQ(near_answer.status, PoseStatus::kOk) << x << " " << has_prior;
      EXPECT_EQ(far_answer.status, near_answer.status);
      EXPECT_LT((placed(T, {}).inverse() * near_answer.T_map_lidar).translation().norm(), 0.05);
      Eigen::Isometry3d back = far_answer.T_map_lidar;
      back.translation() -= corner_m(kFar);
      const Eigen::Isometry3d difference = near_answer.T_map_lidar.inverse() * back;
      EXPECT_LT(difference.translation().norm(), 1e-4) << x << " " << has_prior;
      EXPECT_LT(maps::rotation_angle_rad(difference.linear()), 1e-6) << x << " " << has_prior;
      EXPECT_NEAR(far_answer.inlier_ratio, near_answer.inlier_ratio, 1e-6);
    }
  }
}

TEST_F(FarMaps, AStreetGoesOnAcrossABorderInEitherRegionsWindow) {
  const auto index = MapIndex::open(*map({}));
  const auto first = index->around(maps::RegionId{0, 0});
  const auto second = index->around(maps::RegionId{1, 0});
  EXPECT_EQ(second->origin().x() - first->origin().x(), kBorderM);
  std::size_t found = 0;
  for (const Eigen::Vector3f& p_lidar : scan(pose_at(60.0, 0.0)).positions) {
    const Eigen::Vector3d p = placed(pose_at(60.0, 0.0), {}) * p_lidar.cast<double>();
    for (std::size_t level = 0; level < first->levels().size(); ++level) {
      const auto a = first->levels()[level].nearest((p - first->origin()).cast<float>(), 0.01F);
      const auto b = second->levels()[level].nearest((p - second->origin()).cast<float>(), 0.01F);
      // Where two voxels are as near, or a cell's border is, rounding may choose.
      if (a.voxel != b.voxel) continue;
      ++found;
      if (a.voxel == nullptr) continue;
      EXPECT_LT((a.mean.cast<double>() + first->origin() - b.mean.cast<double>() - second->origin())
                    .norm(),
                2e-4);
    }
  }
  EXPECT_GT(found, 2.98 * static_cast<double>(scan(pose_at(60.0, 0.0)).size()));
}

}  // namespace far_maps_test
}  // namespace stillmap::localization
