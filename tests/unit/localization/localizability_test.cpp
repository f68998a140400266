#include <stillmap/localization/localizability.hpp>

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <numbers>
#include <vector>

#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::localization {
namespace localizability_test {

using maps::MapPoint;
using maps::PointKind;
using maps::TileId;
using ::stillmap::test::TemporaryFolder;

/// Walls and ground as a map has them: points all over, 1 cm off.
class Plates {
 public:
  /// From one place on the ground to another, 4 m high.
  void wall(const Eigen::Vector2d& from, const Eigen::Vector2d& to) {
    const Eigen::Vector2d along = (to - from).normalized();
    const Eigen::Vector2d across(-along.y(), along.x());
    const double length_m = (to - from).norm();
    // Not in columns: one alone in a voxel would pass for a post.
    for (double left = kPointsPerM2 * length_m * kHeightM; left > 0.0; left -= 1.0) {
      const Eigen::Vector2d p =
          from + random_.uniform(0.0, length_m) * along + 0.01 * random_.normal() * across;
      add(p.x(), p.y(), random_.uniform(0.0, kHeightM), PointKind::kMeasured);
    }
  }
  void ground(double half_x, double half_y) {
    for (double x = -half_x; x < half_x; x += kStepM)
      for (double y = -half_y; y < half_y; y += kStepM)
        add(x, y, 0.01 * random_.normal(), PointKind::kGround);
  }
  /// What follows is turned by so much.
  void turn(double yaw_rad) { T_map_plates_ = Eigen::Rotation2Dd(yaw_rad); }

  maps::TileLayer layer() {
    const auto map = package();
    return localizability_of(*map, *MapIndex::build(*map)).value();
  }
  std::shared_ptr<const maps::MapPackage> package() {
    maps::MapPackageWriter writer(folder_.path() / "map");
    for (const auto& [id, points] : tiles_) writer.add_tile(id, points);
    maps::MapManifest manifest;
    manifest.frame_id = "map";
    manifest.origin = {4000.0, -700.0, 12.0};
    writer.publish(manifest, "{}");
    return maps::MapPackage::open(folder_.path() / "map");
  }
  /// Of the cell at a place. @param band  1 = localizability, 2 = weak direction.
  static float value(const maps::TileLayer& layer, std::size_t band, float x, float y) {
    const TileId tile{.level = 0,
                      .x = static_cast<std::int32_t>(std::floor(x / maps::kTileSizeM)),
                      .y = static_cast<std::int32_t>(std::floor(y / maps::kTileSizeM))};
    const auto found = std::find(layer.tiles.begin(), layer.tiles.end(), tile);
    if (found == layer.tiles.end()) return std::nanf("");
    return layer.bands.at(band).values.at(static_cast<std::size_t>(found - layer.tiles.begin()) *
                                              layer.cells_per_tile() +
                                          maps::cell_of(tile, layer.cells_per_side, x, y));
  }
  /// Two walls 10 m apart, 160 m long, and the ground between them.
  void corridor() {
    wall({-80.0, -5.0}, {80.0, -5.0});
    wall({-80.0, 5.0}, {80.0, 5.0});
    ground(80.0, 5.0);
  }

 private:
  static constexpr double kStepM = 0.2;
  static constexpr double kPointsPerM2 = 50.0;
  static constexpr double kHeightM = 4.0;
  void add(double x, double y, double z, PointKind kind) {
    const Eigen::Vector2d p = T_map_plates_ * Eigen::Vector2d(x, y);
    const TileId tile{.level = 0,
                      .x = static_cast<std::int32_t>(std::floor(p.x() / maps::kTileSizeM)),
                      .y = static_cast<std::int32_t>(std::floor(p.y() / maps::kTileSizeM))};
    tiles_[tile].push_back(MapPoint{.x = static_cast<float>(p.x()),
                                    .y = static_cast<float>(p.y()),
                                    .z = static_cast<float>(z),
                                    .intensity = 0.0F,
                                    .observations = 1,
                                    .kind = kind,
                                    .object = 0});
  }

  TemporaryFolder folder_;
  test::Random random_{7};
  Eigen::Rotation2Dd T_map_plates_{0.0};
  std::map<TileId, std::vector<MapPoint>> tiles_;
};

class Localizability : public ::testing::Test, protected Plates {};

TEST_F(Localizability, YardHoldsAScanInEveryWay) {
  wall({-15.0, -15.0}, {15.0, -15.0});
  wall({-15.0, 15.0}, {15.0, 15.0});
  wall({-15.0, -15.0}, {-15.0, 15.0});
  wall({15.0, -15.0}, {15.0, 15.0});
  ground(15.0, 15.0);
  const maps::TileLayer yard = layer();
  EXPECT_EQ(yard.cell_m(), 5.0);
  ASSERT_EQ(yard.bands.size(), 3U);
  EXPECT_NEAR(value(yard, 0, 2.5F, 2.5F), 0.0F, 0.1F);
  for (const float x : {-7.5F, -2.5F, 2.5F, 7.5F}) EXPECT_GT(value(yard, 1, x, 2.5F), 0.4F) << x;
  for (std::size_t i = 0; i < yard.bands[1].values.size(); ++i) {
    const float told = yard.bands[1].values[i];
    EXPECT_EQ(std::isnan(told), std::isnan(yard.bands[0].values[i]));
    if (std::isnan(told)) continue;
    EXPECT_TRUE(told >= 0.0F && told <= 1.0F) << told;
  }
}

TEST_F(Localizability, CorridorLetsAScanSlideAlongIt) {
  corridor();
  const maps::TileLayer corridor = layer();
  EXPECT_LT(value(corridor, 1, 2.5F, 2.5F), 0.02F);
  EXPECT_NEAR(value(corridor, 2, 2.5F, 2.5F), 0.0F, 0.05F);
  // At its end one sees how far it goes no better: nothing is there.
  EXPECT_LT(value(corridor, 1, 77.5F, 2.5F), 0.02F);
}

TEST_F(Localizability, WeakDirectionTurnsWithTheMap) {
  for (const double yaw_deg : {-60.0, 30.0, 90.0}) {
    SCOPED_TRACE(yaw_deg);
    Plates each;
    each.turn(yaw_deg * std::numbers::pi / 180.0);
    each.corridor();
    const maps::TileLayer turned = each.layer();
    EXPECT_LT(value(turned, 1, 0.1F, 0.1F), 0.02F);
    const double off_rad = std::remainder(
        static_cast<double>(value(turned, 2, 0.1F, 0.1F)) - yaw_deg * std::numbers::pi / 180.0,
        std::numbers::pi);
    EXPECT_NEAR(off_rad, 0.0, 0.05);
  }
}

TEST_F(Localizability, WallAcrossTheCorridorTellsWhereAlongItOneIs) {
  corridor();
  wall({30.0, -5.0}, {30.0, 5.0});
  const maps::TileLayer closed = layer();
  EXPECT_GT(value(closed, 1, 17.5F, 2.5F), 0.05F);
  // Too far away.
  EXPECT_LT(value(closed, 1, -42.5F, 2.5F), 0.02F);
  // Behind it the same.
  EXPECT_GT(value(closed, 1, 42.5F, 2.5F), 0.05F);
}

TEST_F(Localizability, WhatWallsHideTellsNothing) {
  corridor();
  for (const double x : {-20.0, -10.0, 0.0, 10.0, 20.0}) {
    wall({x, 7.0}, {x, 30.0});
    wall({x, -30.0}, {x, -7.0});
  }
  EXPECT_LT(value(layer(), 1, 2.5F, 2.5F), 0.02F);
}

TEST_F(Localizability, OpenGroundTellsNothing) {
  ground(30.0, 30.0);
  const maps::TileLayer open = layer();
  EXPECT_EQ(value(open, 1, 2.5F, 2.5F), 0.0F);
  EXPECT_TRUE(std::isnan(value(open, 2, 2.5F, 2.5F)));
}

TEST_F(Localizability, PlacesWithoutGroundHaveNoValue) {
  ground(5.0, 5.0);
  wall({-15.0, -15.0}, {15.0, -15.0});
  const maps::TileLayer some = layer();
  EXPECT_FALSE(std::isnan(value(some, 1, 2.5F, 2.5F)));
  EXPECT_TRUE(std::isnan(value(some, 1, 2.5F, -14.5F))) << "a wall alone is no place to stand";
  EXPECT_TRUE(std::isnan(value(some, 1, 12.5F, 12.5F)));
}

TEST_F(Localizability, StopsWhenToldTo) {
  ground(5.0, 5.0);
  const auto map = package();
  const auto index = MapIndex::build(*map);
  int asked = 0;
  EXPECT_FALSE(localizability_of(*map, *index, [&] { return ++asked < 6; }));
  EXPECT_EQ(asked, 6);
}

}  // namespace localizability_test
}  // namespace stillmap::localization
