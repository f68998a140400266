#include "stacking/tile_stack.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/tile_steps.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <vector>

#include "stacking/tile_points.hpp"
#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::mapping {
namespace tile_stack_test {

using maps::MapPoint;
using maps::PointKind;
using testing::ElementsAre;
using testing::IsEmpty;

StackedPoint at(double x, double y, double z, PointKind kind = PointKind::kMeasured,
                float intensity = 0.0F, std::uint32_t object = 0) {
  return {{x, y, z}, intensity, kind, object};
}

/// Stacks lists of points, one a scan, and gives back the finished tiles.
std::vector<TilePoints> stacked(const VoxelGrid& grid,
                                const std::vector<std::vector<StackedPoint>>& scans,
                                std::size_t most_voxels = 1'000'000) {
  const test::TemporaryFolder folder;
  TileStack stack(folder.path() / "tiles", most_voxels);
  for (std::uint32_t i = 0; i < scans.size(); ++i) {
    ScanVoxels voxels(grid, i);
    for (const StackedPoint& point : scans[i]) EXPECT_TRUE(voxels.add(point));
    stack.add(voxels);
  }
  std::vector<TilePoints> tiles;
  for (const maps::TileId id : stack.tiles())
    tiles.push_back(to_points(grid, id, stack.take(id),
                              [](std::uint32_t) { return Eigen::Vector3f(0.0F, 0.0F, 2.0F); }));
  return tiles;
}

std::vector<MapPoint> points_of(const std::vector<TilePoints>& tiles) {
  std::vector<MapPoint> all;
  for (const TilePoints& tile : tiles) {
    const auto placed = tile.placed(Eigen::Vector3d::Zero()).points_from(Eigen::Vector3d::Zero());
    all.insert(all.end(), placed.begin(), placed.end());
  }
  return all;
}

TEST(TileStack, TakesTheMeanOfAVoxelRelativeToTheOrigin) {
  const VoxelGrid grid({100.0, 200.0, 10.0}, 1.0);
  const auto points =
      points_of(stacked(grid, {{at(100.25, 200.5, 10.125, PointKind::kMeasured, 10.0F)},
                               {at(100.75, 200.75, 10.375, PointKind::kMeasured, 20.0F)}}));
  ASSERT_EQ(points.size(), 1U);
  EXPECT_EQ(points[0].x, maps::in_tile_steps(0.5));
  EXPECT_EQ(points[0].y, maps::in_tile_steps(0.625));
  EXPECT_EQ(points[0].z, maps::in_height_steps(0.25));
  EXPECT_FLOAT_EQ(points[0].intensity, 15.0F);
  EXPECT_EQ(points[0].observations, 2U);
  EXPECT_EQ(points[0].kind, PointKind::kMeasured);
  EXPECT_EQ(points[0].object, 0U);
}

TEST(TileStack, KeepsStepsFarFromTheZeroOfTheMap) {
  const VoxelGrid grid({4.0e6, 5.0e5, 0.0}, 0.1);
  const MapPoint point = points_of(stacked(grid, {{at(4.0e6 + 3.137, 5.0e5 - 7.219, 1.5)}})).at(0);
  EXPECT_NEAR(static_cast<double>(point.x), 3.137, maps::kTileStepM / 2 + 1e-6);
  EXPECT_NEAR(static_cast<double>(point.y), -7.219, maps::kTileStepM / 2 + 1e-6);
}

TEST(TileStack, PartsVoxelsAtTheirSidesAlsoBelowZero) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 1.0);
  EXPECT_EQ(points_of(stacked(grid, {{at(-0.1, 0.5, 0.5), at(0.1, 0.5, 0.5)}})).size(), 2U);
  EXPECT_EQ(points_of(stacked(grid, {{at(0.5, 0.5, -0.1), at(0.5, 0.5, 0.1)}})).size(), 2U);
}

TEST(TileStack, KeepsMeasuredAndMovedPointsOfAVoxelApart) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 1.0);
  const auto tiles =
      stacked(grid, {{at(0.2, 0.5, 0.5)}, {at(0.8, 0.5, 0.5, PointKind::kProjected, 0.0F, 300)}});
  const auto points = points_of(tiles);
  ASSERT_EQ(points.size(), 2U);
  EXPECT_EQ(points[0].kind, PointKind::kMeasured);
  EXPECT_EQ(points[0].x, maps::in_tile_steps(0.2));
  EXPECT_EQ(points[1].kind, PointKind::kProjected);
  EXPECT_EQ(points[1].object, 1 + 299 % 255);
  EXPECT_EQ(tiles[0].history[1].object, 300U);
}

TEST(TileStack, CallsAVoxelGroundByItsMajority) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 1.0);
  const StackedPoint ground = at(0.5, 0.5, 0.5, PointKind::kGround);
  EXPECT_EQ(points_of(stacked(grid, {{ground, ground, at(0.5, 0.5, 0.5)}}))[0].kind,
            PointKind::kGround);
  EXPECT_EQ(points_of(stacked(grid, {{ground, at(0.5, 0.5, 0.5)}}))[0].kind, PointKind::kMeasured);
}

TEST(TileStack, TellsTheFirstAndTheLastScanThatSawAPoint) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 1.0);
  const StackedPoint p = at(0.5, 0.5, 0.5);
  const auto tiles = stacked(grid, {{}, {p, p}, {}, {p}, {}});
  EXPECT_EQ(tiles.at(0).history.at(0).first_scan, 1U);
  EXPECT_EQ(tiles[0].history[0].last_scan, 3U);
}

TEST(TileStack, CountsTheScansOfAVoxelNotItsPoints) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 1.0);
  const test::TemporaryFolder folder;
  TileStack stack(folder.path() / "tiles", 100);
  for (const std::uint32_t scan : {0U, 1U}) {
    ScanVoxels voxels(grid, scan);
    for (int k = 0; k < 3; ++k) ASSERT_TRUE(voxels.add(at(0.5, 0.5, 0.5)));
    stack.add(voxels);
  }
  const std::vector<VoxelSum> sums = stack.take({0, 0, 0});
  ASSERT_EQ(sums.size(), 1U);
  EXPECT_EQ(sums[0].observations, 6U);
  EXPECT_EQ(sums[0].scans, 2U);
}

TEST(TileStack, PutsEveryPointIntoItsTileWhateverTheVoxel) {
  test::Random random(4);
  for (const double voxel : {0.1, 0.15, 0.37, 2.0}) {
    const VoxelGrid grid({5.0, -3.0, 1.0}, voxel);
    std::vector<StackedPoint> points;
    for (int i = 0; i < 3000; ++i)
      points.push_back(at(random.uniform(-45, 45), random.uniform(-45, 45), random.uniform(-2, 9)));
    points.push_back(at(5.0 + std::nextafter(20.0, 0.0), -3.0, 1.0));
    for (const TilePoints& tile : stacked(grid, {points})) {
      for (const MapPoint& p : tile.points) {
        ASSERT_TRUE(p.x >= 0.0F && p.x < 20.0F) << p.x;
        ASSERT_TRUE(p.y >= 0.0F && p.y < 20.0F) << p.y;
      }
    }
  }
}

TEST(MapOrigin, IsTheNearestCornerOfTheTilesOfTheFrame) {
  EXPECT_EQ(map_origin_near({9.0, -11.0, 1.6}), Eigen::Vector3d(0.0, -20.0, 2.0));
  EXPECT_EQ(map_origin_near({500'011.0, 4'000'009.9, -0.4}),
            Eigen::Vector3d(500'020.0, 4'000'000.0, 0.0));
  EXPECT_FALSE(std::signbit(map_origin_near({-0.3, 0.0, -0.3}).x()));
}

TEST(TilePoints, AreInStepsWithinTheirTile) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 0.1);
  for (const double x : {19.9999999, -0.0000001, 163.2, -411.7}) {
    const auto tiles = stacked(grid, {{at(x, 0.5 * x, 0.01 * x)}});
    ASSERT_EQ(tiles.size(), 1U);
    const MapPoint& p = tiles[0].points.at(0);
    EXPECT_EQ(maps::in_steps(Eigen::Vector3d(p.x, p.y, p.z)), Eigen::Vector3f(p.x, p.y, p.z));
    const Eigen::Vector3d found = tiles[0].placed(Eigen::Vector3d::Zero()).position(p);
    EXPECT_LT((found - Eigen::Vector3d(x, 0.5 * x, 0.01 * x)).norm(), 0.00034);
    EXPECT_EQ(std::floor(found.x() / maps::kTileSizeM), tiles[0].id.x);
  }
}

TEST(TilePoints, StayInTheirVoxel) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 0.2);
  for (int i = -500; i < 500; ++i) {
    for (const double beside : {-2e-4, -1e-5, 1e-5, 2e-4}) {
      const double x = 0.2 * i + beside;
      const auto place = grid.find({x, 0.5 * x, x});
      const MapPoint p = points_of(stacked(grid, {{at(x, 0.5 * x, x)}})).at(0);
      const auto found = grid.find(Eigen::Vector3d(p.x, p.y, p.z));
      ASSERT_TRUE(place && found);
      EXPECT_EQ(found->tile, place->tile) << x;
      EXPECT_EQ(found->voxel, place->voxel) << x;
    }
  }
}

TEST(VoxelGrid, PutsAPointAHairBelowATilesBorderIntoItsLastVoxel) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 0.1);
  const auto hair = grid.find({-1e-17, 5.0, 0.0});
  const auto below = grid.find({-0.05, 5.0, 0.0});
  ASSERT_TRUE(hair && below);
  EXPECT_EQ(hair->tile, below->tile);
  EXPECT_EQ(hair->voxel, below->voxel);
}

TEST(TileStack, LeavesOutWhatIsNotFiniteOrTooFar) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 0.1);
  ScanVoxels voxels(grid, 0);
  EXPECT_FALSE(voxels.add(at(std::nan(""), 0.0, 0.0)));
  EXPECT_FALSE(voxels.add(at(0.0, 0.0, std::numeric_limits<double>::infinity())));
  EXPECT_FALSE(voxels.add(at(0.0, 0.0, 2.0e5)));
  EXPECT_FALSE(voxels.add(at(-1.0e9, 0.0, 0.0)));
  EXPECT_THAT(voxels.tiles(), IsEmpty());
}

/// Twenty scans of a drive along x.
std::vector<std::vector<StackedPoint>> long_drive() {
  test::Random random(7);
  std::vector<std::vector<StackedPoint>> scans(20);
  for (std::size_t i = 0; i < scans.size(); ++i) {
    for (int k = 0; k < 400; ++k) {
      const double x = 10.0 * static_cast<double>(i) + random.uniform(-30, 30);
      scans[i].push_back(at(x, random.uniform(-8, 8), random.uniform(0, 1)));
    }
  }
  return scans;
}

using Sums = std::map<maps::TileId, std::vector<VoxelSum>>;

/// Of a drive that comes back along the same way.
Sums sums_of(std::size_t most_voxels, const std::function<bool(maps::TileId)>& wanted = {}) {
  const test::TemporaryFolder folder;
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 0.5);
  TileStack stack(folder.path() / "tiles", most_voxels);
  std::vector<std::vector<StackedPoint>> scans = long_drive();
  const auto way = scans;
  scans.insert(scans.end(), way.rbegin(), way.rend());
  for (std::uint32_t i = 0; i < scans.size(); ++i) {
    // As if most scans between saw nothing: what was left behind is soon not recent.
    ScanVoxels voxels(grid, 20 * i);
    for (const StackedPoint& point : scans[i]) EXPECT_TRUE(voxels.add(point));
    stack.add(voxels, wanted);
  }
  EXPECT_EQ(std::filesystem::exists(folder.path() / "tiles"), most_voxels < 1'000'000);
  Sums sums;
  for (const maps::TileId id : stack.tiles()) sums[id] = stack.take(id);
  return sums;
}

void expect_same_bits(const std::vector<VoxelSum>& a, const std::vector<VoxelSum>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i)
    ASSERT_EQ(std::memcmp(&a[i], &b[i], sizeof(VoxelSum)), 0) << i;
}

TEST(TileStack, HasTheSameBitsWhenTilesGoToTheDisk) {
  const Sums whole = sums_of(1'000'000);
  const Sums spilled = sums_of(500);
  ASSERT_EQ(spilled.size(), whole.size());
  for (const auto& [id, sums] : whole) expect_same_bits(spilled.at(id), sums);
}

TEST(TileStack, HasTheSameBitsWhenItHoldsSomeOfTheTiles) {
  const Sums whole = sums_of(500);
  const auto is_odd = [](maps::TileId id) { return id.x % 2 != 0; };
  const Sums some = sums_of(500, is_odd);
  EXPECT_LT(some.size(), whole.size());
  for (const auto& [id, sums] : whole) {
    ASSERT_EQ(some.contains(id), is_odd(id));
    if (is_odd(id)) expect_same_bits(some.at(id), sums);
  }
}

/// Of `long_drive`, driven back and forth so that tiles are left and met again.
constexpr int kWays = 8;

TEST(TileStack, PutsAwayWhatTheVehicleHasLeftAndRemovesItsFile) {
  const test::TemporaryFolder folder;
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 0.5);
  const auto drive = long_drive();
  {
    TileStack stack(folder.path() / "tiles", 500);
    std::uint32_t number = 0;
    std::size_t most = 0;
    for (int way = 0; way < kWays; ++way) {
      for (std::size_t i = 0; i < drive.size(); ++i) {
        // Long stops, so that what is far is not recent.
        for (int stop = 0; stop < 4; ++stop) {
          ScanVoxels voxels(grid, number++);
          for (const StackedPoint& point : drive[way % 2 == 0 ? i : drive.size() - 1 - i])
            (void)voxels.add(point);
          stack.add(voxels);
          most = std::max(most, stack.voxels_in_memory());
        }
      }
    }
    EXPECT_LT(most, 8000U);
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "tiles"));
  }
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "tiles"));
}

TEST(TileStack, DoesNotWriteAgainAndAgainWhatAPlaceIsFullOf) {
  const test::TemporaryFolder folder;
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 0.1);
  TileStack stack(folder.path() / "tiles", 1000);
  test::Random random(3);
  for (std::uint32_t i = 0; i < 300; ++i) {
    ScanVoxels voxels(grid, i);
    for (int k = 0; k < 200; ++k)
      (void)voxels.add(at(random.uniform(-30, 30), random.uniform(-30, 30), 0.0));
    stack.add(voxels);
  }
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "tiles"));
}

TEST(TileStack, SaysWhichFileCannotBeWritten) {
  TileStack stack("/proc/no/such/folder", 1);
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 0.5);
  ScanVoxels here(grid, 0), later(grid, 1000);
  (void)here.add(at(0, 0, 0));
  (void)later.add(at(50, 0, 0));
  (void)later.add(at(53, 0, 0));
  stack.add(here);
  EXPECT_THROW(stack.add(later), maps::StorageError);
}

TEST(TilePoints, LookAlongTheNormalToWhereTheyWereSeenFrom) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 0.1);
  std::vector<StackedPoint> floor_and_post;
  for (int x = 0; x < 20; ++x) {
    for (int y = 0; y < 20; ++y)
      floor_and_post.push_back(at(5 + 0.1 * x + 0.05, 5 + 0.1 * y + 0.05, 0.05));
  }
  floor_and_post.push_back(at(15.0, 15.0, 3.0));
  const auto tiles = stacked(grid, {floor_and_post});
  ASSERT_EQ(tiles.size(), 1U);
  for (std::size_t i = 0; i < tiles[0].points.size(); ++i) {
    const maps::PointHistory& history = tiles[0].history[i];
    const bool floor = tiles[0].points[i].z < 1.0F;
    EXPECT_THAT(history.normal, ElementsAre(0, 0, floor ? 127 : 0));
    EXPECT_EQ(history.planarity > 250, floor);
  }
}

TEST(TilePoints, OfFilledGroundAreMarkedAndHaveNoObservation) {
  const VoxelGrid grid(Eigen::Vector3d::Zero(), 0.1);
  TilePoints tile = to_points(grid, {0, 0, 0}, {}, nullptr);
  add_filled({1.0, 2.0, 0.5}, 4, tile);
  ASSERT_EQ(tile.points.size(), 1U);
  EXPECT_EQ(tile.points[0].kind, PointKind::kFilled);
  EXPECT_EQ(tile.points[0].observations, 0U);
  EXPECT_EQ(tile.history[0].object, 4U);
}

}  // namespace tile_stack_test
}  // namespace stillmap::mapping
