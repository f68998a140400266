#include "import/column_ground.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

namespace stillmap::mapping {
namespace column_ground_test {

using Points = std::vector<Eigen::Vector3f>;

/// A level patch of points every 0.2 m, from corner to corner.
void add_patch(Points& points, const Eigen::Vector3f& from, const Eigen::Vector2f& to) {
  for (float x = from.x() + 0.1F; x < to.x(); x += 0.2F) {
    for (float y = from.y() + 0.1F; y < to.y(); y += 0.2F) points.emplace_back(x, y, from.z());
  }
}

ColumnGround ground_of(const Points& points) {
  std::map<maps::TileId, Points> tiles;
  for (const Eigen::Vector3f& p : points)
    tiles[{0, static_cast<std::int32_t>(std::floor(p.x() / 20.0F)),
           static_cast<std::int32_t>(std::floor(p.y() / 20.0F))}]
        .push_back(p);
  ColumnGround ground;
  for (const auto& [id, in_tile] : tiles) ground.add(id, in_tile);
  ground.finish();
  return ground;
}

TEST(ColumnGround, IsTheLowestLayerAcrossTilesAndBelowZero) {
  Points points;
  add_patch(points, {-12.0F, -12.0F, 3.0F}, {12.0F, 12.0F});
  const ColumnGround ground = ground_of(points);
  for (const float x : {-11.9F, -0.1F, 0.1F, 11.9F})
    EXPECT_FLOAT_EQ(ground.at({x, -5.0F, 9.0F}).value(), 3.0F) << x;
  EXPECT_FALSE(ground.at({15.0F, 0.0F, 3.0F}));
}

TEST(ColumnGround, RoofsCarsAndSmallPatchesAreNone) {
  Points points;
  add_patch(points, {0.0F, 0.0F, 0.0F}, {20.0F, 20.0F});
  add_patch(points, {24.0F, 0.0F, 6.0F}, {28.0F, 4.0F});
  const ColumnGround ground = ground_of(points);
  EXPECT_TRUE(ground.at({10.0F, 10.0F, 0.0F}));
  EXPECT_FALSE(ground.at({26.0F, 2.0F, 6.0F})) << "16 m^2";
}

TEST(ColumnGround, GoesOnOverKerbsAndUnderAReflection) {
  Points points;
  add_patch(points, {0.0F, 0.0F, 0.0F}, {10.0F, 4.0F});
  add_patch(points, {0.0F, 4.0F, 0.14F}, {10.0F, 8.0F});
  points.emplace_back(5.1F, 2.1F, -2.0F);
  const ColumnGround ground = ground_of(points);
  EXPECT_FLOAT_EQ(ground.at({5.0F, 6.0F, 0.0F}).value(), 0.14F);
  EXPECT_FLOAT_EQ(ground.at({5.1F, 2.1F, 0.0F}).value(), 0.0F);
}

TEST(ColumnGround, PlacesStandUprightOnFreeGroundFourMetresApart) {
  Points points;
  add_patch(points, {0.0F, 0.0F, -1.0F}, {20.0F, 12.0F});
  // A car on the middle of the first square, 4 m wide and long, so that nothing of it is free.
  add_patch(points, {0.0F, 0.0F, 0.2F}, {4.0F, 4.0F});
  const std::vector<Eigen::Isometry3d> places = ground_of(points).places();
  EXPECT_EQ(places.size(), 14U);
  for (const Eigen::Isometry3d& place : places) {
    EXPECT_NEAR(place.translation().z(), 0.8, 1e-6);
    EXPECT_NEAR(place.linear()(2, 2), 1.0, 1e-9);
    EXPECT_FALSE((place.translation().head<2>().array() < 4.0).all()) << "in the car";
  }
}

TEST(ColumnGround, PlacesOnASlopeStandAcrossIt) {
  Points points;
  for (float x = 0.1F; x < 20.0F; x += 0.2F) {
    for (float y = 0.1F; y < 20.0F; y += 0.2F) points.emplace_back(x, y, 0.1F * x);
  }
  const std::vector<Eigen::Isometry3d> places = ground_of(points).places();
  ASSERT_EQ(places.size(), 25U);
  const Eigen::Vector3d up = Eigen::Vector3d(-0.1, 0.0, 1.0).normalized();
  for (const Eigen::Isometry3d& place : places) EXPECT_GT(place.linear().col(2).dot(up), 0.9999);
}

TEST(ColumnGround, NothingIsNoGround) {
  ColumnGround ground;
  ground.finish();
  EXPECT_FALSE(ground.at({0.0F, 0.0F, 0.0F}));
  EXPECT_TRUE(ground.places().empty());
}

}  // namespace column_ground_test
}  // namespace stillmap::mapping
