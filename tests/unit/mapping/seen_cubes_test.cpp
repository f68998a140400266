#include "cleaning/seen_cubes.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace seen_cubes_test {

/// Flat ground and a wall at y = 14, seen every 2 m along x at a height of 2 m, by two drives: the
/// second one stays west of x = 20. A board hides what is behind it from the second one.
class SeenCubesTest : public ::testing::Test {
 protected:
  SeenCubesTest() {
    const test::ScanPattern pattern{
        .rings = 48, .columns = 900, .lowest_rad = -0.6, .highest_rad = 0.3};
    for (std::size_t drive = 0; drive < 2; ++drive) {
      test::SyntheticWorld world;
      world.boxes = {{{-60.0, 14.0, 0.0}, {80.0, 14.5, 6.0}}};
      if (drive == 1) world.boxes.push_back({{-60.0, 6.0, 0.0}, {80.0, 6.3, 4.0}});
      for (double x = -40.0; x <= (drive == 0 ? 60.0 : 10.0); x += 2.0) {
        const Eigen::Isometry3d T = test::pose_at(x, 0.0);
        kept_.push_back(std::make_shared<const RangeView>(world.scan(T, pattern).positions,
                                                          std::vector<std::uint8_t>{}));
        views_.T_local_lidar.push_back(T);
        drive_of_scan_.push_back(drive);
      }
    }
    views_.read = [this](std::size_t scan) { return kept_.at(scan); };
  }
  [[nodiscard]] maps::TileEvidence seen(maps::TileId tile) const {
    return SeenCubes(views_, drive_of_scan_).of(tile, 0);
  }

  std::vector<std::shared_ptr<const RangeView>> kept_;
  PosedViews views_;
  std::vector<std::size_t> drive_of_scan_;
};

TEST_F(SeenCubesTest, AreFreeHitOrNeitherByDrive) {
  const maps::TileEvidence evidence = seen({.level = 0, .x = 0, .y = 0});
  ASSERT_EQ(evidence.drives.size(), 2U);
  const auto& open = evidence.drives[0];
  const auto& hidden = evidence.drives[1];
  EXPECT_EQ(hidden.drive, 1U);
  const auto cube = [&](double y, double z) { return *evidence.cube_of({10.5, y, z}); };
  EXPECT_TRUE(open.free[cube(8.5, 1.5)]);
  EXPECT_FALSE(open.hit[cube(8.5, 1.5)]);
  EXPECT_TRUE(open.hit[cube(13.9, 1.5)] || open.hit[cube(14.5, 1.5)]) << "the wall";
  EXPECT_FALSE(open.free[cube(16.5, 1.5)]) << "behind the wall";
  EXPECT_FALSE(open.hit[cube(16.5, 1.5)]);
  EXPECT_TRUE(hidden.free[cube(3.5, 1.5)]);
  EXPECT_FALSE(hidden.free[cube(8.5, 1.5)]) << "behind the board";
  EXPECT_TRUE(evidence.free()[cube(8.5, 1.5)]) << "one drive saw it";
  EXPECT_FALSE(evidence.free()[cube(16.5, 1.5)]);
}

TEST_F(SeenCubesTest, AreOfDrivesThatCameNear) {
  EXPECT_EQ(seen({.level = 0, .x = 2, .y = 0}).drives.size(), 1U);
  EXPECT_TRUE(seen({.level = 0, .x = 7, .y = 0}).drives.empty());
  EXPECT_TRUE(seen({.level = 0, .x = 0, .y = -4}).drives.empty());
}

TEST_F(SeenCubesTest, SayNothingWherePosesAreInDoubt) {
  views_.doubts.assign(views_.T_local_lidar.size(), {.m = 1.0F, .rad = 0.0F});
  EXPECT_TRUE(seen({.level = 0, .x = 0, .y = 0}).drives.empty());
}

TEST_F(SeenCubesTest, OfAVehicleThatStandsAreOfSeveralTimes) {
  // A board comes, or it goes.
  const test::ScanPattern pattern{
      .rings = 48, .columns = 900, .lowest_rad = -0.6, .highest_rad = 0.3};
  const auto view = [&](bool board) {
    test::SyntheticWorld world;
    world.boxes = {{{-60.0, 14.0, 0.0}, {80.0, 14.5, 6.0}}};
    if (board) world.boxes.push_back({{5.0, 6.4, 0.0}, {15.0, 6.6, 4.0}});
    return std::make_shared<const RangeView>(
        world.scan(test::pose_at(10.0, 0.0), pattern).positions, std::vector<std::uint8_t>{});
  };
  const std::vector<std::shared_ptr<const RangeView>> both{view(false), view(true)};
  for (const bool comes : {true, false}) {
    PosedViews views;
    views.T_local_lidar.assign(300, test::pose_at(10.0, 0.0));
    views.read = [&](std::size_t scan) { return both[(scan >= 150) == comes ? 1 : 0]; };
    const std::vector<std::size_t> drives(300, 0);
    const maps::TileEvidence evidence =
        SeenCubes(views, drives).of({.level = 0, .x = 0, .y = 0}, 0);
    ASSERT_EQ(evidence.drives.size(), 1U);
    const std::size_t cube = *evidence.cube_of({10.5, 6.5, 1.5});
    EXPECT_TRUE(evidence.drives[0].hit[cube]) << comes;
    EXPECT_TRUE(evidence.drives[0].free[cube]) << comes;
    EXPECT_FALSE(evidence.free()[cube]) << comes;
  }
}

TEST(TileEvidence, CubesAreNumberedByXThenYThenHeight) {
  const maps::TileEvidence evidence{.base_m = -3, .drives = {}};
  for (std::size_t cube = 0; cube < maps::TileEvidence::kCubes; cube += 7)
    EXPECT_EQ(evidence.cube_of(evidence.middle_of(cube)), cube);
  EXPECT_EQ(evidence.cube_of({0.5, 0.5, -1.5}), 1U);
  EXPECT_EQ(evidence.cube_of({0.5, 1.5, -2.5}), 8U);
  EXPECT_EQ(evidence.cube_of({1.5, 0.5, -2.5}), 160U);
  EXPECT_EQ(evidence.cube_of({-1e-6, 20.0, -2.5}), 19U * 8U);
  EXPECT_FALSE(evidence.cube_of({0.5, 0.5, -3.1}));
  EXPECT_FALSE(evidence.cube_of({0.5, 0.5, 5.0}));
}

}  // namespace seen_cubes_test
}  // namespace stillmap::mapping
