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
  EXPECT_TRUE(evidence.is_free(cube(8.5, 1.5))) << "one drive saw it";
  EXPECT_FALSE(evidence.is_free(cube(16.5, 1.5)));
}

TEST_F(SeenCubesTest, AreOfDrivesThatCameNear) {
  EXPECT_EQ(seen({.level = 0, .x = 2, .y = 0}).drives.size(), 1U);
  EXPECT_TRUE(seen({.level = 0, .x = 7, .y = 0}).drives.empty());
  EXPECT_TRUE(seen({.level = 0, .x = 0, .y = -4}).drives.empty());
}

TEST_F(SeenCubesTest, SayNothingWherePosesAreInDoubt) {
  views_.doubts.assign(views_.T_local_lidar.size(), {.m = 1.0F, .rad = 0.0F});
  for (const auto& each : seen({.level = 0, .x = 0, .y = 0}).drives) EXPECT_TRUE(each.free.none());
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
