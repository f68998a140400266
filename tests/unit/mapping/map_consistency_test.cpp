#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/map_consistency.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Geometry>

#include <cmath>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <vector>

#include "consistency/surface_cells.hpp"
#include "stacking/tile_points.hpp"
#include "stacking/tile_stack.hpp"
#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::mapping {
namespace map_consistency_test {

using ::testing::Each;
using ::testing::IsEmpty;

constexpr double kVoxelM = 0.1;
/// Far from the tile's border, and in the middle of a cell.
const Eigen::Vector3d kMiddle(10.25, 10.25, 1.25);

MapConsistency consistency_of(const std::vector<SurfacePoint>& points) {
  ConsistencySum sum;
  sum.add(surface_cells(points, kVoxelM));
  return sum.result();
}

/// Points of a rectangle of 5.5 x 3.5 m, spread evenly, with normal noise across.
std::vector<SurfacePoint> noisy_plane(double sigma_m, const Eigen::Matrix3d& R, std::size_t count) {
  test::Random random(1);
  std::vector<SurfacePoint> points;
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3d p(random.uniform(-2.75, 2.75), random.uniform(-1.75, 1.75),
                            sigma_m * random.normal());
    points.push_back({(kMiddle + R * p).cast<float>(), 1.0F, false});
  }
  return points;
}

Eigen::Matrix3d turned(double yaw_rad, double pitch_rad, double roll_rad) {
  return (Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()) *
          Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

/// Points of a normal distribution around the middle of the tile.
std::vector<SurfacePoint> blob(const Eigen::Vector3d& sigmas_m, const Eigen::Matrix3d& R) {
  test::Random random(2);
  std::vector<SurfacePoint> points;
  for (int i = 0; i < 3000; ++i) {
    const Eigen::Vector3d p(random.normal(), random.normal(), random.normal());
    points.push_back({(kMiddle + R * sigmas_m.cwiseProduct(p)).cast<float>(), 1.0F, false});
  }
  return points;
}

double entropy_of_normal(const Eigen::Vector3d& sigmas_m) {
  return 1.5 * std::log(2.0 * std::numbers::pi * std::numbers::e) + std::log(sigmas_m.prod());
}

TEST(MapConsistency, ThicknessOfAPlaneIsTheDeviationOfItsNoise) {
  struct Case {
    Eigen::Matrix3d R;
    double tolerance, least_planar;
  };
  // Cells cut corners and narrow strips off an oblique plane, and some of its noise.
  const std::vector<Case> cases{{turned(0.3, 0.7, 0.2), 0.06, 0.5},
                                {turned(0.0, std::acos(0.0), 0.0), 0.03, 0.95}};
  for (const double sigma_m : {0.005, 0.02, 0.04}) {
    for (const Case& each : cases) {
      const MapConsistency found = consistency_of(noisy_plane(sigma_m, each.R, 10'000));
      EXPECT_NEAR(found.walls.median_m, sigma_m, each.tolerance * sigma_m);
      EXPECT_GT(found.walls.p95_m, found.walls.median_m);
      EXPECT_LT(found.walls.p95_m, 1.4 * sigma_m);
      EXPECT_GT(found.walls.planar_share(), each.least_planar);
      EXPECT_GT(found.walls.planar_cells, 60U);
      EXPECT_EQ(found.ground.cells, 0U);
    }
  }
}

TEST(MapConsistency, EntropyOfABlobIsThatOfItsNormalDistribution) {
  for (const Eigen::Vector3d& sigmas_m :
       {Eigen::Vector3d(0.02, 0.02, 0.02), Eigen::Vector3d(0.03, 0.02, 0.004)}) {
    const MapConsistency found = consistency_of(blob(sigmas_m, turned(0.4, -0.3, 1.0)));
    EXPECT_EQ(found.entropy_points, 750U);
    EXPECT_NEAR(found.mean_map_entropy, entropy_of_normal(sigmas_m), 0.05);
  }
}

TEST(MapConsistency, APointCountsAsOftenAsItWasSeen) {
  // Two layers, 6 cm apart; the first was seen three times as often.
  std::vector<SurfacePoint> points;
  for (int i = 0; i < 25; ++i) {
    const Eigen::Vector3f p(10.05F + 0.1F * static_cast<float>(i % 5), 10.2F,
                            1.05F + 0.1F * static_cast<float>(i / 5));
    points.push_back({p, 3.0F, false});
    points.push_back({p + Eigen::Vector3f(0.0F, 0.06F, 0.0F), 1.0F, false});
  }
  const std::vector<SurfaceCell> cells = surface_cells(points, kVoxelM);
  ASSERT_EQ(cells.size(), 1U);
  // 3/4 * 1/4 of the squared distance; (25 * 4)^2 / (25 * (9 + 1)) = 40 points know as much.
  EXPECT_NEAR(cells[0].thickness_m, 0.06 * std::sqrt(3.0 / 16.0 * 40.0 / 37.0), 1e-6);
  EXPECT_TRUE(cells[0].is_planar);
}

TEST(MapConsistency, DoesNotChangeWhenTheMapIsMoved) {
  std::vector<SurfacePoint> still = noisy_plane(0.02, turned(0.3, 1.2, 0.0), 8'000);
  const std::vector<SurfacePoint> floor = noisy_plane(0.02, turned(0.0, 0.0, 0.0), 8'000);
  still.insert(still.end(), floor.begin(), floor.end());
  std::vector<SurfacePoint> moved = still;
  const Eigen::Isometry3d T =
      Eigen::Translation3d(Eigen::Vector3d(0.33, -0.21, 3.4)) * Eigen::Translation3d(kMiddle) *
      Eigen::Isometry3d(turned(0.6, 0.0, 0.0)) * Eigen::Translation3d(-kMiddle);
  for (SurfacePoint& point : moved)
    point.position = (T * point.position.cast<double>()).cast<float>();
  const MapConsistency a = consistency_of(still), b = consistency_of(moved);
  ASSERT_EQ(a.entropy_points, 4'000U);
  EXPECT_NEAR(static_cast<double>(b.entropy_points), 4'000.0, 10.0);
  EXPECT_NEAR(a.mean_map_entropy, b.mean_map_entropy, 0.02);
  // The cells lie otherwise, and other points are asked.
  EXPECT_NEAR(a.walls.median_m, b.walls.median_m, 0.05 * a.walls.median_m);
}

TEST(MapConsistency, TellsWallsFromTheGroundInFrontOfThem) {
  std::vector<SurfacePoint> points = noisy_plane(0.03, turned(0.0, std::acos(0.0), 0.0), 10'000);
  for (SurfacePoint point : noisy_plane(0.01, turned(0.0, 0.0, 0.0), 10'000)) {
    point.is_ground = true;
    points.push_back(point);
  }
  const MapConsistency found = consistency_of(points);
  EXPECT_NEAR(found.walls.median_m, 0.03, 0.001);
  EXPECT_NEAR(found.ground.median_m, 0.01, 0.0005);
}

TEST(MapConsistency, APoleIsNoWallAndNeitherIsABush) {
  test::Random random(3);
  std::vector<SurfacePoint> pole, bush;
  for (int i = 0; i < 4000; ++i) {
    const double angle = random.uniform(0.0, 2.0 * std::numbers::pi);
    const Eigen::Vector3d around(0.05 * std::cos(angle), 0.05 * std::sin(angle),
                                 random.uniform(0.0, 3.0));
    pole.push_back({(Eigen::Vector3d(10.25, 10.25, 0.0) + around).cast<float>(), 1.0F, false});
    const Eigen::Vector3d p(random.uniform(9.0, 11.0), random.uniform(9.0, 11.0),
                            random.uniform(0.0, 1.0));
    bush.push_back({p.cast<float>(), 1.0F, false});
  }
  EXPECT_EQ(consistency_of(pole).walls.planar_cells, 0U);
  EXPECT_EQ(consistency_of(pole).walls.cells, 6U);
  EXPECT_TRUE(std::isnan(consistency_of(pole).walls.median_m));
  EXPECT_EQ(consistency_of(bush).walls.planar_share(), 0.0);
}

TEST(MapConsistency, AsksAsManyPointsOfFineVoxelsAsOfCoarseOnes) {
  const std::vector<SurfacePoint> points = blob({0.02, 0.02, 0.02}, turned(0.0, 0.0, 0.0));
  for (const auto& [voxel_size_m, asked] :
       {std::pair(0.5, 3000U), std::pair(0.2, 3000U), std::pair(0.1, 750U), std::pair(0.02, 30U)}) {
    ConsistencySum sum;
    sum.add(surface_cells(points, voxel_size_m));
    EXPECT_EQ(sum.result().entropy_points, asked) << voxel_size_m;
    EXPECT_NEAR(sum.result().mean_map_entropy, entropy_of_normal({0.02, 0.02, 0.02}), 0.05);
  }
}

TEST(MapConsistency, AsksNoPointWhoseNeighboursMayLieInTheNextTile) {
  std::vector<SurfacePoint> points = blob({0.02, 0.02, 0.02}, turned(0.0, 0.0, 0.0));
  for (SurfacePoint& point : points) point.position.x() += 9.6F;
  const MapConsistency found = consistency_of(points);
  EXPECT_EQ(found.entropy_points, 0U);
  EXPECT_TRUE(std::isnan(found.mean_map_entropy));
  EXPECT_GT(found.walls.cells, 0U);
}

TEST(MapConsistency, KnowsNothingOfTooFewPointsAndOfPointsWithoutExtent) {
  EXPECT_THAT(surface_cells({}, kVoxelM), IsEmpty());
  const SurfacePoint point{kMiddle.cast<float>(), 1.0F, false};
  for (const std::size_t count : {1U, 7U, 10U, 100U}) {
    const MapConsistency found = consistency_of(std::vector<SurfacePoint>(count, point));
    EXPECT_EQ(found.entropy_points, count < 100 ? 0U : 25U) << count;
    EXPECT_EQ(found.walls.planar_cells, 0U) << count;
  }
  std::vector<SurfacePoint> flat;
  for (int i = 0; i < 25; ++i)
    flat.push_back(
        {{10.0F + 0.1F * static_cast<float>(i % 5), 10.0F + 0.1F * static_cast<float>(i / 5), 1.0F},
         1.0F,
         false});
  EXPECT_LT(consistency_of(flat).mean_map_entropy, -4.0);
  EXPECT_GT(consistency_of(flat).mean_map_entropy, -8.0);
  EXPECT_NEAR(consistency_of(flat).walls.median_m, 0.0, 1e-4);
  std::vector<SurfacePoint> broken(20, point);
  broken[3].position.x() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW((void)surface_cells(broken, kVoxelM), std::invalid_argument);
}

TEST(MapConsistency, LeavesOutWhatWasNotMeasuredWhereItLies) {
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  const maps::MapTile tile(zero, zero,
                           {{21.0F, -19.0F, 1.0F, 0.0F, 7, maps::PointKind::kMeasured, 0},
                            {22.0F, -18.0F, 0.0F, 0.0F, 0, maps::PointKind::kGround, 0},
                            {23.0F, -17.0F, 0.0F, 0.0F, 3, maps::PointKind::kProjected, 1},
                            {24.0F, -16.0F, 0.0F, 0.0F, 0, maps::PointKind::kFilled, 1}});
  const std::vector<SurfacePoint> found = surface_points({0, 1, -1}, tile);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].position, Eigen::Vector3f(1.0F, 1.0F, 1.0F));
  EXPECT_EQ(found[0].weight, 7.0F);
  EXPECT_FALSE(found[0].is_ground);
  EXPECT_EQ(found[1].weight, 1.0F);
  EXPECT_TRUE(found[1].is_ground);
}

/// What a build stacks of a street, with the poses of its scans disturbed.
class DisturbedStreet : public ::testing::Test {
 protected:
  [[nodiscard]] static std::vector<TilePoints> tiles(double sigma_m) {
    test::ScanPattern pattern;
    pattern.columns = 900;
    pattern.rings = 48;
    pattern.max_range_m = 40.0;
    pattern.noise_m = 0.02;
    const test::SyntheticWorld world = test::street(5, 40.0);
    const VoxelGrid grid(Eigen::Vector3d::Zero(), kVoxelM);
    const test::TemporaryFolder folder;
    TileStack stack(folder.path() / "scratch", 10'000'000);
    test::Random random(4);
    for (std::uint32_t scan = 0; scan < 25; ++scan) {
      pattern.seed = scan + 1;
      const Eigen::Isometry3d T = test::pose_at(scan, 0.0);
      const Eigen::Vector3d error =
          sigma_m * Eigen::Vector3d(random.normal(), random.normal(), random.normal());
      ScanVoxels voxels(grid, scan);
      for (const Eigen::Vector3f& p : world.scan(T, pattern).positions) {
        StackedPoint point;
        point.p_map = T * p.cast<double>();
        point.kind = point.p_map.z() < 0.1 ? maps::PointKind::kGround : maps::PointKind::kMeasured;
        point.p_map += error;
        voxels.add(point);
      }
      stack.add(voxels);
    }
    std::vector<TilePoints> out;
    for (const maps::TileId id : stack.tiles())
      out.push_back(to_points(grid, id, stack.take(id),
                              [](std::uint32_t) { return Eigen::Vector3f(0.0F, 0.0F, 1.8F); }));
    return out;
  }
  [[nodiscard]] static MapConsistency consistency(double sigma_m) {
    ConsistencySum sum;
    for (const TilePoints& tile : tiles(sigma_m))
      sum.add(
          surface_cells(surface_points(tile.id, tile.placed(Eigen::Vector3d::Zero())), kVoxelM));
    return sum.result();
  }
};

TEST_F(DisturbedStreet, HasThickerWallsAndGroundAndAHigherEntropy) {
  MapConsistency before = consistency(0.0);
  ASSERT_GT(before.walls.planar_cells, 500U);
  ASSERT_GT(before.ground.planar_cells, 500U);
  ASSERT_GT(before.entropy_points, 10'000U);
  for (const double sigma_m : {0.02, 0.05, 0.1}) {
    const MapConsistency found = consistency(sigma_m);
    EXPECT_GT(found.walls.median_m, before.walls.median_m + 0.002) << sigma_m;
    EXPECT_GT(found.ground.median_m, before.ground.median_m + 0.002) << sigma_m;
    EXPECT_GT(found.mean_map_entropy, before.mean_map_entropy + 0.1) << sigma_m;
    if (sigma_m == 0.05) {
      EXPECT_GT(found.walls.median_m, 1.5 * consistency(0.0).walls.median_m);
    }
    before = found;
  }
}

TEST_F(DisturbedStreet, IsTheSameInThePackageForAnyNumberOfThreads) {
  const test::TemporaryFolder folder;
  maps::MapPackageWriter writer(folder.path() / "map");
  ConsistencySum sum;
  for (const TilePoints& tile : tiles(0.02)) {
    writer.add_tile(tile.id, tile.placed(Eigen::Vector3d::Zero()), tile.history);
    ConsistencySum of_tile;
    of_tile.add(
        surface_cells(surface_points(tile.id, tile.placed(Eigen::Vector3d::Zero())), kVoxelM));
    sum.add(of_tile);
  }
  maps::MapManifest manifest;
  manifest.frame_id = "local";
  manifest.voxel_size_m = kVoxelM;
  (void)writer.publish(manifest, "{}");
  const auto map = maps::MapPackage::open(folder.path() / "map");
  CancelFlag cancel(false);
  std::size_t told = 0;
  const std::string serial = to_json(map_consistency(
      *map, 1, [&](std::string_view, std::size_t done, std::size_t) { told = done; }, cancel));
  EXPECT_EQ(told, map->manifest().extent.tiles);
  EXPECT_EQ(serial, to_json(sum.result()));
  for (const int threads : {2, 5})
    EXPECT_EQ(to_json(map_consistency(*map, threads, {}, cancel)), serial);
  cancel = true;
  EXPECT_THROW((void)map_consistency(*map, 1, {}, cancel), Cancelled);
}

TEST(MapConsistency, WritesNullForWhatIsNotKnown) {
  const auto json = nlohmann::json::parse(to_json(MapConsistency{}));
  EXPECT_TRUE(json.at("mean_map_entropy").is_null());
  EXPECT_EQ(json.at("entropy_points"), 0);
  for (const char* kind : {"walls", "ground"}) {
    for (const char* key : {"thickness_median_m", "thickness_p95_m", "planar_share"})
      EXPECT_TRUE(json.at(kind).at(key).is_null()) << kind << key;
    EXPECT_EQ(json.at(kind).at("planar_cells"), 0);
    EXPECT_EQ(json.at(kind).at("cells"), 0);
  }
}

}  // namespace map_consistency_test
}  // namespace stillmap::mapping
