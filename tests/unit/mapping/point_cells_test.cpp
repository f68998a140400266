#include "core/point_cells.hpp"

#include "support/synthetic_world.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace stillmap::mapping {
namespace point_cells_test {

std::vector<Eigen::Vector3f> cloud(std::size_t size, double half_m, std::uint64_t seed) {
  test::Random random(seed);
  std::vector<Eigen::Vector3f> points;
  for (std::size_t i = 0; i < size; ++i) {
    points.emplace_back(Eigen::Vector3d(random.uniform(-half_m, half_m),
                                        random.uniform(-half_m, half_m),
                                        random.uniform(-half_m, half_m))
                            .cast<float>());
  }
  return points;
}

TEST(PointCells, FindsTheSamePointAsATryOfAll) {
  const std::vector<Eigen::Vector3f> points = cloud(800, 1.0, 1);
  const PointCells cells(points, 0.2);
  for (const double radius_m : {0.05, 0.1, 0.2, 0.37}) {
    for (const Eigen::Vector3f& p : cloud(200, 1.2, 2)) {
      double best = radius_m * radius_m;
      std::optional<std::uint32_t> expected;
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double squared = (points[i].cast<double>() - p.cast<double>()).squaredNorm();
        if (squared > best || (expected && squared == best)) continue;
        best = squared;
        expected = static_cast<std::uint32_t>(i);
      }
      const auto found = cells.nearest(p, radius_m);
      ASSERT_EQ(found.has_value(), expected.has_value()) << p.transpose();
      EXPECT_EQ(cells.any_within(p, radius_m), expected.has_value());
      if (!found) continue;
      EXPECT_EQ(found->point, *expected);
    }
  }
}

TEST(PointCells, TakesTheRadiusAsWithin) {
  const PointCells cells({{0.0F, 0.0F, 0.0F}}, 0.5);
  EXPECT_TRUE(cells.any_within({0.25F, 0.0F, 0.0F}, 0.25));
  EXPECT_FALSE(cells.any_within({0.2501F, 0.0F, 0.0F}, 0.25));
}

TEST(PointCells, OfEqualDistancesTakesTheFirst) {
  const PointCells cells({{3.0F, 0.0F, 0.0F}, {1.0F, 0.0F, 0.0F}, {-1.0F, 0.0F, 0.0F}}, 1.5);
  EXPECT_EQ(cells.nearest({0.0F, 0.0F, 0.0F}, 1.5)->point, 1U);
  EXPECT_EQ(cells.nearest({2.0F, 0.0F, 0.0F}, 1.5)->point, 0U);
}

TEST(PointCells, ListsThePointsOfACellAsTheyWereGiven) {
  const PointCells cells({{0.1F, 0.1F, 0.1F}, {-0.1F, 0.1F, 0.1F}, {0.2F, 0.2F, 0.2F}}, 1.0);
  ASSERT_EQ(cells.cells(), 2U);
  EXPECT_EQ(cells.cell(0).begin, 0U);
  EXPECT_EQ(cells.cell(0).end, 1U);
  EXPECT_EQ(cells.cell(1).end, 3U);
  EXPECT_THAT(cells.given_index(), testing::ElementsAre(1U, 0U, 2U));
}

TEST(PointCells, EmptyFindsNothing) {
  const PointCells cells({}, 1.0);
  EXPECT_EQ(cells.cells(), 0U);
  EXPECT_FALSE(cells.nearest({0.0F, 0.0F, 0.0F}, 1.0).has_value());
}

TEST(PointCells, FindsNothingNearWhatIsNotFinite) {
  const PointCells cells({{0.0F, 0.0F, 0.0F}}, 1.0);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinite = std::numeric_limits<float>::infinity();
  EXPECT_FALSE(cells.any_within({nan, 0.0F, 0.0F}, 1.0));
  EXPECT_FALSE(cells.any_within({0.0F, infinite, 0.0F}, 1.0));
  EXPECT_FALSE(cells.any_within({0.0F, 0.0F, -1e30F}, 1.0));
}

TEST(PointCells, RefusesWhatItCannotHold) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(PointCells({{nan, 0.0F, 0.0F}}, 1.0), std::invalid_argument);
  EXPECT_THROW(PointCells({{0.0F, nan, 0.0F}}, 1.0), std::invalid_argument);
  EXPECT_THROW(PointCells({{0.0F, 0.0F, 2e6F}}, 1.0), std::invalid_argument);
  EXPECT_THROW(PointCells({}, 0.0), std::invalid_argument);
  EXPECT_THROW(PointCells({}, std::nan("")), std::invalid_argument);
}

}  // namespace point_cells_test
}  // namespace stillmap::mapping
