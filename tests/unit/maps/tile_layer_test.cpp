#include <stillmap/maps/tile_layer.hpp>

#include <gmock/gmock.h>

#include <cmath>

#include "support/package_steps.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace tile_layer_test {

using ::stillmap::test::TemporaryFolder;
using ::testing::ElementsAre;

MapPoint point(float x, float y, float z, std::uint16_t observations = 1,
               PointKind kind = PointKind::kMeasured) {
  return {.x = x,
          .y = y,
          .z = z,
          .intensity = 0,
          .observations = observations,
          .kind = kind,
          .object = 0};
}
PointHistory seen(std::uint32_t first, std::uint32_t last) {
  return {.first_scan = first, .last_scan = last, .object = 0, .normal = {0, 0, 0}, .planarity = 0};
}

class CoverageTest : public ::testing::Test {
 protected:
  void add(TileId id, const std::vector<MapPoint>& points,
           const std::vector<PointHistory>& history = {}) {
    writer_.add_tile(id, points, history);
  }
  TileLayer coverage() {
    MapManifest manifest;
    manifest.frame_id = "map";
    manifest.origin = {1000.0, 2000.0, 30.0};
    writer_.publish(manifest, "{}");
    return coverage_of(*MapPackage::open(folder_.path() / "map")).value();
  }
  static float value(const TileLayer& layer, std::size_t band, std::size_t tile, std::size_t cell) {
    return layer.bands.at(band).values.at(tile * layer.cells_per_tile() + cell);
  }

  static constexpr int kFirstSchema = 1;
  explicit CoverageTest(int schema = kPackageSchema) : schema_(schema) {}
  TemporaryFolder folder_;
  int schema_;
  /// A package of schema 1 may have coarser levels.
  MapPackageWriter writer_{folder_.path() / "map", {}, schema_};
};

TEST_F(CoverageTest, CountsObservationsAndScansOfEachSquareMetre) {
  add({.level = 0, .x = 0, .y = 0},
      {point(0.5F, 0.5F, 2.0F, 3), point(0.9F, 0.1F, -1.0F, 4), point(3.5F, 2.5F, 0.25F, 5),
       point(0.2F, 0.2F, 0.0F, 100, PointKind::kFilled)},
      {seen(1, 7), seen(7, 9), seen(4, 4), seen(0, 50)});
  add({.level = 0, .x = -1, .y = 0}, {point(-0.5F, 19.5F, 1.0F, 65535, PointKind::kGround)},
      {seen(2, 3)});
  const TileLayer layer = coverage();
  EXPECT_EQ(layer.cells_per_side, 20U);
  EXPECT_EQ(layer.cell_m(), 1.0);
  EXPECT_THAT(layer.tiles, ElementsAre(TileId{0, -1, 0}, TileId{0, 0, 0}));
  ASSERT_EQ(layer.bands.size(), 3U);
  EXPECT_EQ(layer.bands[0].name, "height");
  EXPECT_EQ(layer.bands[2].name, "scans");
  for (const TileLayer::Band& band : layer.bands) EXPECT_EQ(band.values.size(), 800U);
  EXPECT_NEAR(value(layer, 0, 1, 0), -1.0, test::kOffByStepsM) << "the lowest";
  EXPECT_EQ(value(layer, 1, 1, 0), 7.0F) << "of measured points";
  EXPECT_EQ(value(layer, 2, 1, 0), 3.0F) << "scans 1, 7 and 9";
  // x = 3, y = 2.
  EXPECT_EQ(value(layer, 1, 1, 43), 5.0F);
  EXPECT_EQ(value(layer, 2, 1, 43), 1.0F);
  for (std::size_t band = 0; band < 3; ++band) EXPECT_TRUE(std::isnan(value(layer, band, 1, 1)));
  // x = -1 is the last cell of its row, y = 19 the last row.
  EXPECT_EQ(value(layer, 1, 0, 399), 65535.0F);
  EXPECT_EQ(value(layer, 2, 0, 399), 2.0F);
}

TEST_F(CoverageTest, SyntheticGroundWasSeenByNobody) {
  add({}, {point(0.5F, 0.5F, 2.0F, 9, PointKind::kFilled)}, {seen(1, 7)});
  const TileLayer layer = coverage();
  EXPECT_NEAR(value(layer, 0, 0, 0), 2.0, test::kOffByStepsM);
  EXPECT_EQ(value(layer, 1, 0, 0), 0.0F);
  EXPECT_EQ(value(layer, 2, 0, 0), 0.0F);
}

class CoverageOfSchema1 : public CoverageTest {
 protected:
  CoverageOfSchema1() : CoverageTest(kFirstSchema) {}
};

TEST_F(CoverageOfSchema1, MapsFromElsewhereDoNotKnowTheirScans) {
  add({}, {point(0.5F, 0.5F, 2.0F, 9)});
  add({.level = 1, .x = 0, .y = 0}, {point(0.5F, 0.5F, 2.0F, 9)});
  const TileLayer layer = coverage();
  EXPECT_EQ(layer.tiles.size(), 1U) << "coarser levels hold the same points again";
  EXPECT_EQ(layer.bands.size(), 2U);
}

TEST_F(CoverageTest, StopsWhenToldTo) {
  add({}, {point(0.5F, 0.5F, 2.0F)});
  MapManifest manifest;
  manifest.frame_id = "map";
  writer_.publish(manifest, "{}");
  const auto map = MapPackage::open(folder_.path() / "map");
  EXPECT_FALSE(coverage_of(*map, [] { return false; }));
}

TEST(TileLayer, HasAtMostAMillionCells) {
  EXPECT_EQ(cells_per_side(0, 20), 20U);
  EXPECT_EQ(cells_per_side(2500, 20), 20U);
  EXPECT_EQ(cells_per_side(2501, 20), 10U);
  EXPECT_EQ(cells_per_side(10'001, 20), 5U);
  EXPECT_EQ(cells_per_side(40'001, 20), 1U);
  EXPECT_EQ(cells_per_side(5'000'000, 20), 1U);
}

TEST(TileLayer, PointsOnTheEdgeOfATileStayInIt) {
  EXPECT_EQ(cell_of({0, 0, 0}, 20, 0.0F, 0.0F), 0U);
  EXPECT_EQ(cell_of({0, 0, 0}, 20, 20.0F, 20.0F), 399U);
  EXPECT_EQ(cell_of({0, -1, 0}, 20, 0.0F, 0.0F), 19U);
  EXPECT_EQ(cell_of({0, 3, -2}, 4, 66.0F, -21.0F), 13U);
}

}  // namespace tile_layer_test
}  // namespace stillmap::maps
