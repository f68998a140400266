#include <stillmap/localization/thinning.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <vector>

namespace stillmap::localization {
namespace thinning_test {

/// A wall 10 m ahead, 20 m wide, points 1 cm apart across and 0.2 m up.
std::vector<Eigen::Vector3f> wall() {
  std::vector<Eigen::Vector3f> points;
  for (int i = -1000; i < 1000; ++i) {
    for (int k = 0; k < 10; ++k)
      points.emplace_back(10.0F, 0.01F * static_cast<float>(i), 0.2F * static_cast<float>(k));
  }
  return points;
}

/// Anywhere within 30 m of the sensor, but 5 m and more away and not near the wall.
std::vector<Eigen::Vector3f> rain(std::size_t count) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> coordinate(-30.0F, 30.0F);
  std::vector<Eigen::Vector3f> points;
  while (points.size() < count) {
    const Eigen::Vector3f p(coordinate(random), coordinate(random),
                            3.0F + 0.1F * coordinate(random));
    if (p.norm() > 5.0F && p.x() < 8.0F) points.push_back(p);
  }
  return points;
}

std::size_t beside_the_wall(const std::vector<Eigen::Vector3f>& points,
                            const std::vector<std::size_t>& kept) {
  return static_cast<std::size_t>(
      std::ranges::count_if(kept, [&](std::size_t i) { return points[i].x() < 9.0F; }));
}

TEST(OnePointACell, KeepsTheFirstPointOfEachCell) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  std::vector<Eigen::Vector3f> points = wall();
  const std::vector<Eigen::Vector3f> drops = rain(3000);
  points.insert(points.end(), drops.begin(), drops.end());
  // Between them what is left out, and points on the borders of cells.
  for (std::size_t i = 0; i < points.size(); i += 7) {
    const Eigen::Vector3f others[] = {{0.0F, 0.0F, 0.0F},    {std::nanf(""), 1.0F, 1.0F},
                                      {9.0F, kInfinity, 0},  {-1.0F, 1.0F, 0.5F},
                                      {-3e9F, 3e9F, 1.0F},   {499.0F, 50.0F, 0.0F},
                                      {-4.0F, -0.0F, -3.5F}, {-4.0F, 0.0F, -3.5F}};
    points[i] = others[i % 8];
  }
  std::vector<std::size_t> expected;
  std::set<std::array<float, 3>> cells;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f& p = points[i];
    if (!(p.norm() < 500.0F && p.norm() >= 2.7F)) continue;
    const Eigen::Array3f cell = (p / 0.5F).array().floor();
    if (cells.insert({cell.x(), cell.y(), cell.z()}).second) expected.push_back(i);
  }
  EXPECT_EQ(one_point_a_cell(points, 0.5F), expected);
}

TEST(OnePointACell, LeavesLonePointsOutAndKeepsSurfaces) {
  std::vector<Eigen::Vector3f> points = wall();
  const std::size_t of_wall = one_point_a_cell(points, 0.5F).size();
  const std::vector<Eigen::Vector3f> drops = rain(1000);
  points.insert(points.end(), drops.begin(), drops.end());
  const auto all = one_point_a_cell(points, 0.5F);
  const auto seen = one_point_a_cell(points, 0.5F, Lone::kLeftOut);
  EXPECT_GT(beside_the_wall(points, all), 900U);
  EXPECT_LT(beside_the_wall(points, seen), 200U);
  EXPECT_EQ(seen.size() - beside_the_wall(points, seen), of_wall);
  EXPECT_TRUE(std::ranges::is_sorted(seen));
}

TEST(OnePointACell, KeepsAScanThatWasThinnedBefore) {
  std::vector<Eigen::Vector3f> ground;
  for (int i = -150; i < 150; ++i) {
    for (int k = -150; k < 150; ++k)
      ground.emplace_back(0.2F * static_cast<float>(i), 0.2F * static_cast<float>(k), -1.8F);
  }
  std::vector<Eigen::Vector3f> thinned;
  for (const std::size_t i : one_point_a_cell(ground, 0.5F)) thinned.push_back(ground[i]);
  ASSERT_GT(thinned.size(), 10'000U);
  // But what lies on the vehicle.
  EXPECT_EQ(one_point_a_cell(thinned, 0.5F, Lone::kLeftOut).size(),
            one_point_a_cell(thinned, 0.5F).size());
}

TEST(OnePointACell, KeepsASparseScan) {
  const std::vector<Eigen::Vector3f> drops = rain(1000);
  EXPECT_EQ(one_point_a_cell(drops, 0.5F, Lone::kLeftOut).size(),
            one_point_a_cell(drops, 0.5F).size());
}

TEST(OnePointACell, KeepsAPoleFarAway) {
  std::vector<Eigen::Vector3f> points = wall();
  // 0.7 degrees a column, 2 degrees a ring: two points a ring on 0.6 m.
  for (int ring = 0; ring < 4; ++ring) {
    for (const float y : {0.0F, 0.5F})
      points.emplace_back(-40.0F, y, 1.4F * static_cast<float>(ring));
  }
  const auto seen = one_point_a_cell(points, 0.5F, Lone::kLeftOut);
  EXPECT_EQ(beside_the_wall(points, seen), beside_the_wall(points, one_point_a_cell(points, 0.5F)));
}

}  // namespace thinning_test
}  // namespace stillmap::localization
