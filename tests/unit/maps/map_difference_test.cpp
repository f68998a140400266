#include <stillmap/maps/map_difference.hpp>

#include <stillmap/maps/error.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <limits>
#include <string>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"
#include "support/tiled_map.hpp"

namespace stillmap::maps {
namespace map_difference_test {

namespace fs = std::filesystem;
using test::map_point;
using test::scattered;
using test::TemporaryFolder;
using test::ThrowsSaying;
using test::write_map;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr auto kVersion = DifferenceSide::kVersion;
constexpr auto kOther = DifferenceSide::kOther;

class Difference : public ::testing::Test {
 protected:
  std::shared_ptr<const MapPackage> map(const std::vector<MapPoint>& points,
                                        const Eigen::Vector3d& origin = Eigen::Vector3d::Zero()) {
    MapManifest manifest;
    manifest.origin = origin;
    return write_map(folder_.path() / ("map" + std::to_string(count_++)), points, manifest);
  }
  static std::shared_ptr<const MapDifference> made(const MapPackage& version,
                                                   const MapPackage& other,
                                                   double tolerance_m = 0.15) {
    MapDifference::make(version, other, tolerance_m);
    return MapDifference::open(version, other, tolerance_m);
  }
  /// As the package has them, from its origin.
  static std::vector<MapPoint> points_of(const MapPackage& map) {
    std::vector<MapPoint> points;
    for (const TileEntry& tile : map.tiles())
      for (const MapPoint& p : map.tile(tile.id).points_from(Eigen::Vector3d::Zero()))
        points.push_back(p);
    return points;
  }
  static std::vector<MapPoint> all(const MapDifference& difference, DifferenceSide side) {
    std::vector<MapPoint> points;
    for (const DifferenceTile& tile : difference.tiles()) {
      if (tile.side != side) continue;
      for (const MapPoint& p : difference.points(tile)) points.push_back(p);
    }
    return points;
  }
  TemporaryFolder folder_{test::memory_folder()};
  int count_ = 0;
};

TEST_F(Difference, OfEqualMapsIsNothing) {
  const auto one = map(scattered(50.0));
  const auto same = map(scattered(50.0));
  EXPECT_THAT(made(*one, *same)->tiles(), IsEmpty());
  EXPECT_THAT(made(*one, *one)->tiles(), IsEmpty());
}

TEST_F(Difference, TellsWhatIsGoneFromWhatWasNotSeen) {
  // Points over 40 m, half a metre high. The other map has the first of them, and counts from
  // another origin: its tiles -1, 1 and 0, 1 are tiles 0, 0 and 1, 0 of the first one.
  std::vector<MapPoint> points;
  for (int i = 0; i < 40; ++i)
    points.push_back({static_cast<float>(i) + 0.5F, 0.5F, 0.5F, 0.0F, 1, PointKind::kMeasured, 0});
  points[27].kind = PointKind::kGround;
  const auto version = map(points);
  const Eigen::Vector3d origin(20.0, -20.0, 3.0);
  const auto at = [&](float x) {
    return MapPoint{x - 20.0F, 20.5F, -2.5F, 0.0F, 1, PointKind::kMeasured, 0};
  };
  // One in another layer, and one in a cube that was seen free: the middle is above its ground.
  const MapPoint high{0.5F, 20.5F, 1.5F, 0.0F, 1, PointKind::kMeasured, 0};
  const MapPoint low{5.5F, 20.5F, -2.9F, 0.0F, 1, PointKind::kGround, 0};
  TileEvidence evidence{.base_m = -3, .drives = {{0, {}, {}}, {2, {}, {}}}};
  for (int x = 0; x < 10; ++x) evidence.drives[0].free.set(*evidence.cube_of({x + 0.5, 0.5, -2.5}));
  evidence.drives[1].hit.set(*evidence.cube_of({2.5, 0.5, -2.5}));
  MapPackageWriter writer(folder_.path() / "seen");
  writer.set_drives({{1, 0}, {1, 0}, {1, 0}});
  writer.add_tile({.level = 0, .x = -1, .y = 1},
                  MapTile(origin, Eigen::Vector3d::Zero(), {at(0.5F)}));
  writer.add_tile({.level = 0, .x = 0, .y = 1},
                  MapTile(origin, Eigen::Vector3d::Zero(), {high, low}), {}, evidence);
  MapManifest manifest;
  manifest.origin = origin;
  writer.publish(manifest, "{}");
  const auto other = MapPackage::open(folder_.path() / "seen");
  const auto difference = made(*version, *other);
  EXPECT_EQ(difference->total(kVersion).points, 39U);
  EXPECT_EQ(difference->total(kVersion).seen_free, 7U)
      << "of ten cubes: something was met in one, one has ground, one point is ground";
  EXPECT_EQ(difference->find(kVersion, 1, 0)->counts.seen_free, 7U);
  EXPECT_EQ(difference->total(kOther).points, 2U);
  EXPECT_EQ(difference->total(kOther).seen_free, 0U) << "the first map says nothing";
}

TEST_F(Difference, PointsOfOneAreThoseWithoutANeighbourInTheOther) {
  const auto one = map({map_point(1, 1, 0), map_point(5, 5, 1, PointKind::kProjected),
                        map_point(-3, 2, 0, PointKind::kGround)});
  const auto other = map({map_point(1, 1, 0.14F), map_point(9, 9, 2, PointKind::kFilled)});
  const auto difference = made(*one, *other);
  EXPECT_EQ(difference->total(kVersion).points, 2U);
  EXPECT_THAT(difference->total(kVersion).kinds, ElementsAre(0, 1, 1, 0));
  EXPECT_EQ(difference->total(kVersion).area_m2, 2U);
  EXPECT_THAT(difference->total(kOther).kinds, ElementsAre(0, 0, 0, 1));
  ASSERT_THAT(difference->tiles(), SizeIs(3));
  const DifferenceTile* tile = difference->find(kVersion, -1, 0);
  ASSERT_NE(tile, nullptr);
  EXPECT_EQ(tile->entry.points, 1U);
  EXPECT_NEAR(difference->points(*tile)[0].x, 17.0, test::kOffByStepsM);
  EXPECT_EQ(difference->find(kOther, -1, 0), nullptr);
  // Of a wider tolerance one more is the same; of a narrower one fewer.
  EXPECT_EQ(made(*one, *other, 0.13)->total(kVersion).points, 3U);
}

TEST_F(Difference, IsWhatComparingAllPairsFinds) {
  const auto one = map(scattered(15.0, 1));
  const auto other = map(scattered(15.0, 2));
  const auto a = points_of(*one);
  const auto b = points_of(*other);
  const double tolerance_m = 0.4;
  const auto lonely = [&](const std::vector<MapPoint>& mine, const std::vector<MapPoint>& theirs) {
    std::uint64_t count = 0;
    for (const MapPoint& p : mine) {
      bool is_near = false;
      for (const MapPoint& q : theirs) {
        const double dx = double{p.x} - double{q.x};
        const double dy = double{p.y} - double{q.y};
        const double dz = double{p.z} - double{q.z};
        is_near = is_near || dx * dx + dy * dy + dz * dz < tolerance_m * tolerance_m;
      }
      count += is_near ? 0 : 1;
    }
    return count;
  };
  const auto difference = made(*one, *other, tolerance_m);
  EXPECT_GT(difference->total(kVersion).points, 500U);
  EXPECT_EQ(difference->total(kVersion).points, lonely(a, b));
  EXPECT_EQ(difference->total(kOther).points, lonely(b, a));
}

TEST_F(Difference, NeighboursAcrossTheTilesEdgeCount) {
  const auto one = map({map_point(19.95F, 5, 0), map_point(39.95F, 5, 0)});
  const auto other = map({map_point(20.05F, 5, 0), map_point(40.15F, 5, 0)});
  const auto difference = made(*one, *other);
  EXPECT_EQ(difference->total(kVersion).points, 1U);
  EXPECT_EQ(difference->find(kVersion, 1, 0)->entry.points, 1U);
  EXPECT_EQ(difference->find(kOther, 2, 0)->entry.points, 1U);
}

TEST_F(Difference, OtherOriginsAreTakenIntoAccount) {
  const auto points = scattered(50.0);
  std::vector<MapPoint> moved = points;
  for (MapPoint& p : moved) {
    p.x -= 33.25F;
    p.y += 7.5F;
    p.z -= 2.0F;
  }
  moved.push_back(map_point(100.0F, 100.0F, 0.0F));
  const auto one = map(points, {1000.0, 2000.0, 3.0});
  const auto other = map(moved, {1033.25, 1992.5, 5.0});
  const auto difference = made(*one, *other);
  EXPECT_EQ(difference->total(kVersion).points, 0U);
  ASSERT_EQ(difference->total(kOther).points, 1U);
  const DifferenceTile* tile = difference->find(kOther, 6, 4);
  ASSERT_NE(tile, nullptr);
  // In the first version 133.25, 92.5, 2.
  const MapPoint p = difference->points(*tile).at(0);
  EXPECT_NEAR(p.x, 13.25, test::kOffByStepsM);
  EXPECT_NEAR(p.y, 12.5, test::kOffByStepsM);
  EXPECT_NEAR(p.z, 2.0, test::kOffByStepsM);
}

TEST_F(Difference, OriginsTooFarApartAreRefused) {
  const auto one = map({map_point(1, 1, 0)});
  const auto far = map({map_point(1, 1, 0)}, {1e9, 0, 0});
  EXPECT_THAT([&] { MapDifference::make(*one, *far, 0.15); },
              ThrowsSaying<InputError>({"an origin 1000000000"}));
}

TEST_F(Difference, FarPlacesAndEmptyMaps) {
  const auto far = map({map_point(9e7F, -9e7F, 9e5F)});
  const auto empty = map({});
  EXPECT_EQ(made(*far, *empty)->total(kVersion).points, 1U);
  EXPECT_EQ(made(*empty, *far)->total(kOther).points, 1U);
  EXPECT_THAT(made(*empty, *empty)->tiles(), IsEmpty());
}

TEST_F(Difference, ToleranceHasBoundsAndMillimetres) {
  const auto one = map({map_point(1, 1, 0)});
  const auto other = map({map_point(1, 1, 1)});
  for (const double wrong : {0.0, 0.009, 2.1, -1.0, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_THROW(MapDifference::make(*one, *other, wrong), std::invalid_argument) << wrong;
  MapDifference::make(*one, *other, 0.1501);
  EXPECT_NO_THROW((void)MapDifference::open(*one, *other, 0.15));
  EXPECT_THROW((void)MapDifference::open(*one, *other, 0.151), StorageError);
  EXPECT_DOUBLE_EQ(MapDifference::usual_tolerance_m(*one, *other), 1.5 * 0.1);
}

TEST_F(Difference, OtherWayRoundIsAnotherOne) {
  const auto one = map({map_point(1, 1, 0)});
  const auto other = map({map_point(1, 1, 1)});
  MapDifference::make(*one, *other, 0.15);
  EXPECT_THROW((void)MapDifference::open(*other, *one, 0.15), StorageError);
}

TEST_F(Difference, KeepsTheNewestFew) {
  const auto one = map({map_point(1, 1, 0)});
  const auto other = map({map_point(1, 1, 1)});
  for (int i = 0; i < 12; ++i) {
    const fs::path file = MapDifference::make(*one, *other, 0.1 + 0.01 * i);
    fs::last_write_time(file, fs::file_time_type::clock::now() - std::chrono::hours(100 - i));
  }
  std::size_t kept = 0;
  for (int i = 0; i < 12; ++i) {
    try {
      (void)MapDifference::open(*one, *other, 0.1 + 0.01 * i);
      ++kept;
      EXPECT_GE(i, 12 - static_cast<int>(MapDifference::kKept));
    } catch (const StorageError&) {
    }
  }
  EXPECT_EQ(kept, MapDifference::kKept);
}

TEST_F(Difference, KeepsNoMoreBytesThanBothVersionsHave) {
  const auto one = map(scattered(50.0, 1));
  const auto other = map(scattered(50.0, 2));
  // Of nearly all points each.
  fs::path last;
  for (int i = 0; i < 4; ++i) last = MapDifference::make(*one, *other, 0.01 + 0.001 * i);
  EXPECT_TRUE(fs::exists(last));
  std::uintmax_t bytes = 0;
  for (const auto& file : fs::directory_iterator(last.parent_path())) bytes += file.file_size();
  EXPECT_LT(bytes, 2 * fs::file_size(last));
}

TEST_F(Difference, StoppedWorkLeavesNothing) {
  const auto one = map(scattered(50.0, 1));
  const auto other = map(scattered(50.0, 2));
  const auto stop = [](double) { return false; };
  EXPECT_THROW(MapDifference::make(*one, *other, 0.15, {.threads = 1, .go_on = stop}), WorkStopped);
  EXPECT_TRUE(fs::is_empty(one->folder() / "differences"));
}

TEST_F(Difference, DamageIsFoundAndMadeAnew) {
  const auto one = map(scattered(50.0, 1));
  const auto other = map(scattered(50.0, 2));
  const auto difference = made(*one, *other);
  const fs::path file = MapDifference::make(*one, *other, 0.15);
  {
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    stream.seekp(300);
    stream.put('!');
  }
  const auto damaged = MapDifference::open(*one, *other, 0.15);
  EXPECT_THROW((void)all(*damaged, kVersion), InputError);
  MapDifference::remove(*one, *other, 0.15);
  EXPECT_EQ(all(*made(*one, *other), kVersion).size(), all(*difference, kVersion).size());
}

}  // namespace map_difference_test
}  // namespace stillmap::maps
