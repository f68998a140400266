#include "stacking/static_map.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace stillmap::mapping {
namespace {

using maps::MapPoint;
using maps::PointKind;

StackedPoint at(double x, double y, double z, PointKind kind = PointKind::kMeasured,
                float intensity = 0.0F, std::uint8_t object = 0) {
  return {{x, y, z}, intensity, kind, object};
}

std::vector<MapPoint> points_of(const StaticMap& map) {
  std::vector<MapPoint> all;
  for (const auto& [id, points] : map.tiles()) all.insert(all.end(), points.begin(), points.end());
  return all;
}

TEST(StaticMap, TakesTheMeanOfAVoxelRelativeToTheOrigin) {
  StaticMap map({100.0, 200.0, 10.0}, 1.0);
  EXPECT_TRUE(map.add(at(100.25, 200.5, 10.125, PointKind::kMeasured, 10.0F)));
  EXPECT_TRUE(map.add(at(100.75, 200.75, 10.375, PointKind::kMeasured, 20.0F)));
  const std::vector<MapPoint> points = points_of(map);
  ASSERT_EQ(points.size(), 1U);
  EXPECT_FLOAT_EQ(points[0].x, 0.5F);
  EXPECT_FLOAT_EQ(points[0].y, 0.625F);
  EXPECT_FLOAT_EQ(points[0].z, 0.25F);
  EXPECT_FLOAT_EQ(points[0].intensity, 15.0F);
  EXPECT_EQ(points[0].observations, 2U);
  EXPECT_EQ(points[0].kind, PointKind::kMeasured);
  EXPECT_EQ(points[0].object, 0U);
}

TEST(StaticMap, KeepsCentimetresFarFromTheZeroOfTheMap) {
  StaticMap map({4.0e6, 5.0e5, 0.0}, 0.1);
  ASSERT_TRUE(map.add(at(4.0e6 + 3.137, 5.0e5 - 7.219, 1.5)));
  const MapPoint point = points_of(map).at(0);
  EXPECT_NEAR(static_cast<double>(point.x), 3.137, 1e-6);
  EXPECT_NEAR(static_cast<double>(point.y), -7.219, 1e-6);
}

TEST(StaticMap, PartsVoxelsAtTheirSidesAlsoBelowZero) {
  StaticMap map(Eigen::Vector3d::Zero(), 1.0);
  (void)map.add(at(-0.1, 0.5, 0.5));
  (void)map.add(at(0.1, 0.5, 0.5));
  EXPECT_EQ(map.size(), 2U);
}

TEST(StaticMap, KeepsMeasuredAndMovedPointsOfAVoxelApart) {
  StaticMap map(Eigen::Vector3d::Zero(), 1.0);
  (void)map.add(at(0.2, 0.5, 0.5));
  (void)map.add(at(0.8, 0.5, 0.5, PointKind::kProjected, 0.0F, 7));
  const std::vector<MapPoint> points = points_of(map);
  ASSERT_EQ(points.size(), 2U);
  EXPECT_EQ(points[0].kind, PointKind::kMeasured);
  EXPECT_FLOAT_EQ(points[0].x, 0.2F);
  EXPECT_EQ(points[1].kind, PointKind::kProjected);
  EXPECT_FLOAT_EQ(points[1].x, 0.8F);
  EXPECT_EQ(points[1].object, 7U);
}

TEST(StaticMap, CallsAVoxelGroundByMajority) {
  const auto kind_of = [](int ground, int other) {
    StaticMap map(Eigen::Vector3d::Zero(), 1.0);
    for (int i = 0; i < ground; ++i) (void)map.add(at(0.5, 0.5, 0.5, PointKind::kGround));
    for (int i = 0; i < other; ++i) (void)map.add(at(0.5, 0.5, 0.5));
    return points_of(map).at(0).kind;
  };
  EXPECT_EQ(kind_of(2, 1), PointKind::kGround);
  EXPECT_EQ(kind_of(1, 1), PointKind::kMeasured);
  EXPECT_EQ(kind_of(1, 2), PointKind::kMeasured);
}

TEST(StaticMap, SortsTilesAndPointsWhateverTheOrderOfAdding) {
  const std::vector<StackedPoint> points = {at(25.0, 1.0, 0.0), at(1.0, 1.0, 3.0),
                                            at(1.0, 1.0, -3.0), at(-1.0, 5.0, 0.0),
                                            at(3.0, 1.0, 0.0)};
  StaticMap forward(Eigen::Vector3d::Zero(), 0.5);
  StaticMap backward(Eigen::Vector3d::Zero(), 0.5);
  for (std::size_t i = 0; i < points.size(); ++i) {
    (void)forward.add(points[i]);
    (void)backward.add(points[points.size() - 1 - i]);
  }
  const auto tiles = forward.tiles();
  const auto other = backward.tiles();
  ASSERT_EQ(tiles.size(), 3U);
  EXPECT_EQ(tiles.at({0, -1, 0}).size(), 1U);
  EXPECT_EQ(tiles.at({0, 0, 0}).size(), 3U);
  EXPECT_EQ(tiles.at({0, 1, 0}).size(), 1U);
  ASSERT_EQ(other.size(), tiles.size());
  for (const auto& [id, tile] : tiles) {
    ASSERT_EQ(other.at(id).size(), tile.size());
    for (std::size_t i = 0; i < tile.size(); ++i) {
      EXPECT_EQ(other.at(id)[i].x, tile[i].x);
      EXPECT_EQ(other.at(id)[i].z, tile[i].z);
    }
  }
}

TEST(StaticMap, SaturatesObservations) {
  StaticMap map(Eigen::Vector3d::Zero(), 1.0);
  for (int i = 0; i < 70000; ++i) (void)map.add(at(0.5, 0.5, 0.5));
  EXPECT_EQ(points_of(map).at(0).observations, 65535U);
}

TEST(StaticMap, RefusesWhatIsBeyondItsGridOrNotFinite) {
  StaticMap map(Eigen::Vector3d::Zero(), 1.0);
  const double half = 1 << 20;
  EXPECT_TRUE(map.add(at(half - 0.5, 0.0, -half)));
  EXPECT_FALSE(map.add(at(half, 0.0, 0.0)));
  EXPECT_FALSE(map.add(at(0.0, 0.0, -half - 0.5)));
  EXPECT_FALSE(map.add(at(0.0, std::numeric_limits<double>::quiet_NaN(), 0.0)));
  EXPECT_FALSE(map.add(at(std::numeric_limits<double>::infinity(), 0.0, 0.0)));
  EXPECT_EQ(map.size(), 1U);
}

TEST(StaticMap, IsEmptyWithoutPoints) {
  EXPECT_TRUE(StaticMap(Eigen::Vector3d::Zero(), 0.1).tiles().empty());
}

TEST(StaticMap, RefusesAVoxelWithoutSize) {
  EXPECT_THROW(StaticMap(Eigen::Vector3d::Zero(), 0.0), std::invalid_argument);
  EXPECT_THROW(StaticMap(Eigen::Vector3d::Zero(), std::nan("")), std::invalid_argument);
}

}  // namespace
}  // namespace stillmap::mapping
