#include "index/map_level.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/error.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/index_voxels.hpp>
#include <support/synthetic_world.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>

namespace stillmap::localization {
namespace map_index_test {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

/// Points 5 cm apart on the rectangle z = 0.3, 0 <= x, y < 4, and a mark at the origin of the grid.
std::vector<Eigen::Vector3d> plate() {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 80; ++i) {
    for (int j = 0; j < 80; ++j) points.emplace_back(0.05 * i, 0.05 * j, 0.3);
  }
  points.emplace_back(0.0, 0.0, 0.0);
  return points;
}

TEST(MapIndexOptions, NamesEveryBrokenBoundAtOnce) {
  MapIndexOptions options;
  EXPECT_THAT(options.violations(), IsEmpty());
  options.finest_voxel_m = std::numeric_limits<double>::quiet_NaN();
  options.levels = 0;
  options.min_points = 2;
  EXPECT_THAT(options.violations(), SizeIs(3));
  EXPECT_THROW((void)MapIndex::build(plate(), options), std::invalid_argument);
}

TEST(MapIndexOptions, SayWhichEdgeDividesARegion) {
  MapIndexOptions options;
  options.finest_voxel_m = 0.3;
  ASSERT_THAT(options.violations(), SizeIs(1));
  EXPECT_THAT(options.violations().front(), HasSubstr("take 0.3007"));
  options.finest_voxel_m = 160.0 / 133.0 / 4.0;
  EXPECT_THAT(options.violations(), IsEmpty());
  for (const double edge_m : {0.1, 0.2, 0.25, 0.5, 1.0, 2.0}) {
    options.finest_voxel_m = edge_m;
    EXPECT_THAT(options.violations(), IsEmpty()) << edge_m;
  }
}

TEST(MapIndex, LevelsGoFromCoarseToFineAndDouble) {
  const auto index = MapIndex::build(plate());
  const auto window = test::window_of(*index);
  ASSERT_THAT(window->levels(), SizeIs(3));
  EXPECT_FLOAT_EQ(window->levels()[0].edge_m, 2.0F);
  EXPECT_FLOAT_EQ(window->levels()[1].edge_m, 1.0F);
  EXPECT_FLOAT_EQ(window->levels()[2].edge_m, 0.5F);
  EXPECT_EQ(window->levels()[0].cells.voxel_count(), 4U);
  EXPECT_EQ(window->levels()[1].cells.voxel_count(), 16U);
  EXPECT_EQ(window->levels()[2].cells.voxel_count(), 64U);
  EXPECT_EQ(index->voxel_count(), 84U);
}

TEST(MapIndex, VoxelOfAPlateHasItsNormalMeanAndVariances) {
  const auto index = MapIndex::build(plate());
  const auto window = test::window_of(*index);
  const Voxel* voxel =
      window->levels().back().nearest(Eigen::Vector3f(1.75F, 1.75F, 0.3F), 0.01F).voxel;
  ASSERT_NE(voxel, nullptr);
  EXPECT_EQ(voxel->points, 100U);
  EXPECT_EQ(voxel->sharp_axes, 1);
  EXPECT_NEAR(std::abs(voxel->axis0.z()), 1.0, 1e-5);
  EXPECT_NEAR(voxel->mean.x(), 1.725, 1e-5);
  EXPECT_NEAR(voxel->mean.z(), 0.3, 1e-5);
  EXPECT_NEAR(voxel->variance0, 0.0, 1e-7);
  // Ten points 5 cm apart: 0.0025 (10^2 - 1) / 12, and 100 / 99 for the estimate from a sample.
  EXPECT_NEAR(voxel->variance2, 0.0025 * 99.0 / 12.0 * 100.0 / 99.0, 1e-5);
}

TEST(MapIndex, VoxelsOfNeighbouringBlocksAndRegionsHoldTheirOwnPoints) {
  // Blocks are 160 m wide, regions 640 m; the lowest corner is the origin.
  std::vector<Eigen::Vector3d> points{Eigen::Vector3d::Zero()};
  for (const double border_m : {160.0, 640.0}) {
    for (const double x :
         {border_m - 0.3, border_m - 0.1, border_m, border_m + 0.2, border_m + 0.4})
      for (const double y : {10.1, 10.2, 10.4}) points.emplace_back(x, y, 1.0 + 0.1 * y);
  }
  const auto index = MapIndex::build(points, {.min_points = 3});
  const auto points_at = [&](double from_m, double to_m) {
    std::vector<std::uint32_t> by_level;
    const auto window = index->around(Eigen::Vector3d(from_m, 10.0, 1.0));
    for (const MapIndex::Level& level : window->levels()) {
      std::uint32_t& sum = by_level.emplace_back(0);
      for (const auto& each : test::voxels_of(level)) {
        // Of the region in the middle.
        const double x = static_cast<double>(each.voxel->mean.x()) + window->origin().x();
        if (x >= from_m && x < to_m) sum += each.voxel->points;
      }
    }
    return by_level;
  };
  for (const double border_m : {160.0, 640.0}) {
    EXPECT_THAT(points_at(border_m - 2.0, border_m), testing::Each(6U)) << border_m;
    EXPECT_THAT(points_at(border_m, border_m + 2.0), testing::Each(9U)) << border_m;
  }
}

TEST(MapIndex, OnlyAnUprightLineOfPointsIsAPole) {
  const auto sharp_axes_along = [](const Eigen::Vector3d& direction) {
    std::vector<Eigen::Vector3d> points{Eigen::Vector3d::Zero()};
    for (int k = 0; k < 40; ++k)
      points.emplace_back(Eigen::Vector3d::Constant(2.05) + 0.01 * k * direction);
    const auto window = test::window_of(*MapIndex::build(points));
    return test::voxels_of(window->levels().back()).front().voxel->sharp_axes;
  };
  EXPECT_EQ(sharp_axes_along(Eigen::Vector3d::UnitZ()), 2);
  EXPECT_EQ(sharp_axes_along(Eigen::Vector3d::UnitX()), 0);
}

TEST(MapIndex, FoliageIsSharpNowhere) {
  test::Random random(3);
  std::vector<Eigen::Vector3d> points;
  for (int k = 0; k < 4000; ++k)
    points.emplace_back(random.uniform(), random.uniform(), random.uniform());
  const auto index = MapIndex::build(points);
  for (const auto& found : test::voxels_of(test::window_of(*index)->levels().back()))
    EXPECT_EQ(found.voxel->sharp_axes, 0);
}

TEST(MapIndex, LeavesOutVoxelsWithTooFewPoints) {
  std::vector<Eigen::Vector3d> points = plate();
  for (int k = 0; k < 4; ++k) points.emplace_back(10.0 + 0.01 * k, 10.0, 10.0);
  EXPECT_EQ(MapIndex::build(points)->voxel_count(), 84U);
  MapIndexOptions options;
  options.min_points = 4;
  EXPECT_EQ(MapIndex::build(points, options)->voxel_count(), 87U);
}

TEST(MapIndex, OriginIsTheLowestCornerSoThatFloatsKeepTheirMillimetresFarAway) {
  const Eigen::Vector3d far(500'000.0, 5'400'000.0, 300.0);
  std::vector<Eigen::Vector3d> points = plate();
  for (Eigen::Vector3d& p : points) p += far;
  const auto near_index = MapIndex::build(plate());
  const auto far_index = MapIndex::build(points);
  EXPECT_NEAR((far_index->origin() - far).norm(), 0.0, 1e-9);
  EXPECT_NEAR((far_index->bounds().min() - far).norm(), 0.0, 1e-6);
  EXPECT_NEAR((far_index->bounds().sizes() - Eigen::Vector3d(3.95, 3.95, 0.3)).norm(), 0.0, 1e-6);
  ASSERT_EQ(near_index->voxel_count(), far_index->voxel_count());
  const auto near_window = test::window_of(*near_index);
  const auto far_window = test::window_of(*far_index);
  const auto near_voxels = test::voxels_of(near_window->levels().back());
  const auto far_voxels = test::voxels_of(far_window->levels().back());
  for (std::size_t k = 0; k < near_voxels.size(); ++k)
    EXPECT_LT((near_voxels[k].mean - far_voxels[k].mean).norm(), 1e-4F);
}

TEST(MapIndex, OrderOfThePointsDoesNotMatterForWhichVoxelsThereAre) {
  std::vector<Eigen::Vector3d> points = plate();
  const auto forward = MapIndex::build(points);
  std::reverse(points.begin(), points.end());
  const auto backward = MapIndex::build(points);
  ASSERT_EQ(forward->voxel_count(), backward->voxel_count());
  const auto forward_window = test::window_of(*forward);
  const auto backward_window = test::window_of(*backward);
  const auto ones = test::voxels_of(forward_window->levels()[0]);
  const auto others = test::voxels_of(backward_window->levels()[0]);
  for (std::size_t k = 0; k < ones.size(); ++k)
    EXPECT_EQ(ones[k].voxel->points, others[k].voxel->points);
}

TEST(MapIndex, RefusesPointsThatAreNotFiniteNoneTooFewOrTooFarOff) {
  EXPECT_THROW((void)MapIndex::build(std::vector<Eigen::Vector3d>{}), maps::InputError);
  EXPECT_THROW((void)MapIndex::build({Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones()}),
               maps::InputError);
  std::vector<Eigen::Vector3d> points = plate();
  points.emplace_back(0.0, std::numeric_limits<double>::quiet_NaN(), 0.0);
  EXPECT_THROW((void)MapIndex::build(points), std::invalid_argument);
  points.back() = Eigen::Vector3d(2e9, 0.0, 0.0);
  EXPECT_THROW((void)MapIndex::build(points), maps::InputError);
  points.back() = Eigen::Vector3d(2e5, 2e5, 0.0);
  EXPECT_EQ(MapIndex::build(points)->voxel_count(), 84U);
}

TEST(MapIndex, LooksUpNothingFarOutsideOrAtNaN) {
  const auto index = MapIndex::build(plate());
  const auto window = test::window_of(*index);
  const MapIndex::Level& level = window->levels().back();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const float x : {1e30F, -1e30F, nan, 1e6F, -3.0F}) {
    EXPECT_EQ(level.nearest(Eigen::Vector3f(x, 0.0F, 0.0F), 0.01F).voxel, nullptr) << x;
  }
}

}  // namespace map_index_test
}  // namespace stillmap::localization
