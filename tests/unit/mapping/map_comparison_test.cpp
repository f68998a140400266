#include "rebuild/map_comparison.hpp"

#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::mapping {
namespace map_comparison_test {

using maps::PointKind;

struct Point {
  Eigen::Vector3d p_map;
  PointKind kind = PointKind::kMeasured;
  std::uint32_t first_scan = 0, last_scan = 40;
};

/// A wall of 10 x 2 m along x with normal noise across.
std::vector<Point> noisy_wall(double from_x_m, double sigma_m, std::uint64_t seed) {
  test::Random random(seed);
  std::vector<Point> points;
  for (int i = 0; i < 6000; ++i)
    points.push_back({{random.uniform(from_x_m, from_x_m + 10.0), 3.25 + sigma_m * random.normal(),
                       random.uniform(0.0, 2.0)}});
  return points;
}

/// Packages of some points, made from a path of 41 scans, 0.1 s apart, along x from -2 to 2.
class MapComparison : public ::testing::Test {
 protected:
  std::shared_ptr<const maps::MapPackage> package(const std::vector<Point>& points,
                                                  const std::vector<maps::MapObject>& objects = {},
                                                  bool with_history = true,
                                                  bool of_a_drive = true) {
    const std::filesystem::path target = folder_.path() / std::to_string(++packages_);
    maps::MapPackageWriter writer(target);
    std::map<maps::TileId, std::pair<std::vector<maps::MapPoint>, std::vector<maps::PointHistory>>>
        tiles;
    for (const Point& point : points) {
      const Eigen::Vector3f p = (point.p_map - origin_).cast<float>();
      auto& tile = tiles[{0, static_cast<int>(std::floor(p.x() / maps::kTileSizeM)),
                          static_cast<int>(std::floor(p.y() / maps::kTileSizeM))}];
      tile.first.push_back({p.x(), p.y(), p.z(), 0.0F, 1, point.kind, 0});
      tile.second.push_back({point.first_scan, point.last_scan, 0, {0, 0, 0}, 0});
    }
    for (const auto& [id, tile] : tiles)
      writer.add_tile(id, tile.first,
                      with_history ? tile.second : std::vector<maps::PointHistory>{});
    std::vector<maps::StampedPose> path;
    for (int i = 0; i <= 40; ++i)
      path.push_back({100'000'000LL * i, test::pose_at(0.1 * i - 2.0, 0.0, 0.0)});
    if (of_a_drive)
      writer.write_trajectory(maps::Trajectory(path));
    else
      writer.write_places({path.front().T_map_lidar, path.back().T_map_lidar});
    writer.write_objects(objects);
    maps::MapManifest manifest;
    manifest.frame_id = "local";
    manifest.origin = origin_;
    manifest.voxel_size_m = 0.1;
    (void)writer.publish(manifest, "{}");
    return maps::MapPackage::open(target);
  }

  [[nodiscard]] StaticLoss loss(const maps::MapPackage& keep, const maps::MapPackage& map) const {
    return static_loss(keep, map, Eigen::Isometry3d::Identity(), {}, cancel_);
  }

  test::TemporaryFolder folder_;
  Eigen::Vector3d origin_{5.0, 0.0, 0.0};
  CancelFlag cancel_{false};

 private:
  int packages_ = 0;
};

TEST_F(MapComparison, LosesWhatHasNoMeasuredPointWithinTwoDecimetres) {
  const auto keep = package({{{3, 0, 1}}, {{4, 0, 1}}, {{5, 0, 1}}, {{25, 0, 1}}});
  const auto map = package({{{3, 0, 1.19}},
                            {{4, 0, 1.21}},
                            {{5, 0, 1}, PointKind::kProjected},
                            {{25, 0, 1}, PointKind::kGround}});
  const StaticLoss found = loss(*keep, *map);
  EXPECT_EQ(found.points, 4U);
  EXPECT_EQ(found.lost, 2U);
  EXPECT_EQ(found.rate(), 0.5);
  EXPECT_EQ(loss(*keep, *keep).lost, 0U);
}

TEST_F(MapComparison, CountsWhatWasSeenForASecond) {
  const auto keep = package({{{3, 0, 1}, PointKind::kMeasured, 0, 10},
                             {{4, 0, 1}, PointKind::kMeasured, 0, 9},
                             {{5, 0, 1}, PointKind::kMeasured, 7, 7},
                             {{6, 0, 1}, PointKind::kMeasured, 0, 1000},
                             {{7, 0, 1}, PointKind::kFilled}});
  const auto map = package({{{50, 0, 1}}});
  EXPECT_EQ(loss(*keep, *map).points, 1U);
}

TEST_F(MapComparison, LeavesOutWhatLaysInTheBoxesOfRemovedObjects) {
  maps::MapObject car;
  car.size_m = {4.0, 2.0, 1.5};
  car.motion = maps::ObjectMotion::kMoving;
  car.placements = {{0, {19.0, 0.0, 0.75}, 0.0}, {1, {40.0, 10.0, 0.75}, std::acos(0.0)}};
  const auto keep = package({{{19, 1.2, 1}},     // in the margin
                             {{19, 1.4, 1}},     // beside it
                             {{20.9, 0, 1}},     // in the next tile
                             {{40, 11.9, 1}},    // along the turned box
                             {{41.9, 10, 1}}});  // across it
  const auto map = package({{{100, 0, 1}}}, {car});
  const StaticLoss found = loss(*keep, *map);
  EXPECT_EQ(found.points, 2U);
  EXPECT_EQ(found.lost, 2U);
}

TEST_F(MapComparison, MovesTheKeepMapToTheOtherOnesFrame) {
  const auto keep = package({{{3, 0, 1}}, {{4, 0, 1}}});
  const auto map = package({{{13, 0, 1}}, {{14, 0, 1}}});
  const Eigen::Isometry3d T(Eigen::Translation3d(10.0, 0.0, 0.0));
  EXPECT_EQ(static_loss(*keep, *map, T, {}, cancel_).lost, 0U);
  EXPECT_EQ(static_loss(*keep, *map, T.inverse(), {}, cancel_).lost, 2U);
}

TEST_F(MapComparison, KnowsNoLossWhereNothingCounts) {
  const auto keep = package({{{3, 0, 1}, PointKind::kMeasured, 0, 1}});
  EXPECT_TRUE(std::isnan(loss(*keep, *keep).rate()));
}

TEST_F(MapComparison, RefusesAKeepMapWithoutHistories) {
  const auto keep = package({{{3, 0, 1}}}, {}, false);
  EXPECT_THROW((void)loss(*keep, *keep), maps::InputError);
}

TEST_F(MapComparison, CoversTheGroundThatTheOtherOneHas) {
  // Path from x = -2 to 2: driven within 2 m, near it within 15 m.
  const auto previous = package({{{0.5, 0.5, 0}, PointKind::kGround},
                                 {{1.5, 0.5, 0}, PointKind::kProjected},
                                 {{0.5, 10.5, 0}, PointKind::kGround},
                                 {{0.5, 11.5, 3}, PointKind::kMeasured},
                                 {{0.5, 30.5, 0}, PointKind::kGround}});
  const auto map = package({{{0.9, 0.1, 0}, PointKind::kFilled},
                            {{1.5, 0.5, 2}, PointKind::kMeasured},
                            {{0.1, 10.9, 0}, PointKind::kGround}});
  const GroundCoverage found =
      ground_coverage(*previous, *map, Eigen::Isometry3d::Identity(), cancel_);
  EXPECT_EQ(found.driven_cells, 2U);
  EXPECT_EQ(found.driven, 0.5);
  EXPECT_EQ(found.near_path_cells, 3U);
  EXPECT_DOUBLE_EQ(found.near_path, 2.0 / 3.0);
  const GroundCoverage itself =
      ground_coverage(*previous, *previous, Eigen::Isometry3d::Identity(), cancel_);
  EXPECT_EQ(itself.driven, 1.0);
  EXPECT_EQ(itself.near_path, 1.0);
}

TEST_F(MapComparison, CoversTheGroundAroundThePlacesOfAMapThatNoDriveMade) {
  // Places at x = -2 and 2.
  const std::vector<Point> ground{{{-2.5, 0.5, 0}, PointKind::kGround},
                                  {{0.5, 0.5, 0}, PointKind::kGround},
                                  {{3.5, 0.5, 0}, PointKind::kGround},
                                  {{0.5, 30.5, 0}, PointKind::kGround}};
  const auto previous = package(ground, {}, true, false);
  const auto map = package({ground.front()});
  const GroundCoverage found =
      ground_coverage(*previous, *map, Eigen::Isometry3d::Identity(), cancel_);
  EXPECT_EQ(found.driven_cells, 3U);
  EXPECT_EQ(found.near_path_cells, 3U);
  EXPECT_DOUBLE_EQ(found.driven, 1.0 / 3.0);
}

TEST_F(MapComparison, KnowsNoCoverageOfNothing) {
  const auto previous = package({{{0.5, 0.5, 0}, PointKind::kMeasured}});
  const GroundCoverage found =
      ground_coverage(*previous, *previous, Eigen::Isometry3d::Identity(), cancel_);
  EXPECT_TRUE(std::isnan(found.driven));
  EXPECT_TRUE(std::isnan(found.near_path));
}

TEST_F(MapComparison, TellsThatWallsBecameThickerWhereBothVersionsHaveThem) {
  // The first was built from x = 0 to 30, the second from 10 to 40; what is in one of them alone is
  // of another thickness.
  std::vector<Point> before = noisy_wall(10.0, 0.02, 1), now = noisy_wall(10.0, 0.05, 2);
  for (const Point& point : noisy_wall(20.0, 0.02, 3)) before.push_back(point);
  for (const Point& point : noisy_wall(20.0, 0.05, 4)) now.push_back(point);
  for (const Point& point : noisy_wall(0.0, 0.07, 5)) before.push_back(point);
  for (const Point& point : noisy_wall(30.0, 0.005, 6)) now.push_back(point);
  const auto previous = package(before), map = package(now);
  const Eigen::Isometry3d same = Eigen::Isometry3d::Identity();
  const ConsistencyChange change = consistency_change(*previous, *map, same, 1, {}, cancel_);
  // 40 cells along, 4 up.
  EXPECT_EQ(change.map.walls.cells, change.previous.walls.cells);
  EXPECT_EQ(change.map.walls.planar_cells, change.previous.walls.planar_cells);
  EXPECT_NEAR(static_cast<double>(change.map.walls.planar_cells), 160.0, 8.0);
  EXPECT_NEAR(change.previous.walls.median_m, 0.02, 0.001);
  EXPECT_NEAR(change.map.walls.median_m, 0.05, 0.0025);
  EXPECT_EQ(change.map.entropy_points, change.previous.entropy_points);
  // ln(0.05 / 0.02), less at the ends of the wall.
  EXPECT_NEAR(change.map.mean_map_entropy - change.previous.mean_map_entropy, 0.9, 0.1);
  const ConsistencyChange none = consistency_change(*map, *map, same, 3, {}, cancel_);
  EXPECT_EQ(none.map.walls.median_m, none.previous.walls.median_m);
  EXPECT_EQ(none.map.mean_map_entropy, none.previous.mean_map_entropy);
}

TEST_F(MapComparison, ComparesWallsOfAVersionInAnotherFrame) {
  const Eigen::Isometry3d T = test::pose_at(37.3, -20.9, 0.4, 1.0);
  const std::vector<Point> wall = noisy_wall(0.0, 0.03, 1);
  std::vector<Point> moved = wall;
  for (Point& point : moved) point.p_map = T * point.p_map;
  const auto previous = package(wall), map = package(moved);
  const ConsistencyChange change = consistency_change(*previous, *map, T, 2, {}, cancel_);
  EXPECT_GT(change.map.walls.planar_cells, 80U);
  EXPECT_NEAR(change.map.walls.median_m, change.previous.walls.median_m, 1e-4);
  EXPECT_NEAR(change.map.mean_map_entropy, change.previous.mean_map_entropy, 0.02);
  // Nothing is where the other one has something.
  const ConsistencyChange apart =
      consistency_change(*previous, *map, Eigen::Isometry3d::Identity(), 1, {}, cancel_);
  EXPECT_EQ(apart.map.walls.cells, 0U);
  EXPECT_TRUE(std::isnan(apart.map.walls.median_m));
}

TEST_F(MapComparison, CountsACellThatIsTooThickForAPlaneInOneVersion) {
  const auto previous = package(noisy_wall(10.0, 0.02, 1));
  const auto map = package(noisy_wall(10.0, 0.09, 2));
  const ConsistencyChange change =
      consistency_change(*previous, *map, Eigen::Isometry3d::Identity(), 1, {}, cancel_);
  EXPECT_GT(change.map.walls.planar_cells, 70U);
  EXPECT_GT(change.map.walls.median_m, 0.07);
}

TEST_F(MapComparison, StopsWhenCancelled) {
  const auto keep = package({{{3, 0, 1}}});
  cancel_ = true;
  EXPECT_THROW(
      (void)consistency_change(*keep, *keep, Eigen::Isometry3d::Identity(), 1, {}, cancel_),
      Cancelled);
  EXPECT_THROW((void)loss(*keep, *keep), Cancelled);
  EXPECT_THROW((void)ground_coverage(*keep, *keep, Eigen::Isometry3d::Identity(), cancel_),
               Cancelled);
}

}  // namespace map_comparison_test
}  // namespace stillmap::mapping
