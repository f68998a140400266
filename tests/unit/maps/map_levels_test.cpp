#include <stillmap/maps/map_levels.hpp>

#include <stillmap/maps/error.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "levels/voxel_thinning.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"
#include "support/tiled_map.hpp"

namespace stillmap::maps {
namespace map_levels_test {

namespace fs = std::filesystem;
using test::map_point;
using test::scattered;
using test::TemporaryFolder;
using test::ThrowsSaying;
using test::write_map;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

/// A point's bytes, to be found again by.
std::string bytes_of(const MapPoint& point) {
  std::string bytes(sizeof(point), '\0');
  std::memcpy(bytes.data(), &point, sizeof(point));
  return bytes;
}

std::string text_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

fs::path levels_file(const MapPackage& map) { return map.folder() / "levels" / "levels.tiles"; }

/// Points of a tile of any level, from the corner of one above it.
std::vector<MapPoint> points_of(const MapPackage& map, const MapLevels& levels, TileId id,
                                TileId above) {
  MapTile tile = id.level > 0 ? MapTile(Eigen::Vector3d::Zero(), corner_of(id), levels.points(id))
                              : map.tile(id);
  return std::move(tile).points_from(corner_of(above));
}

std::vector<TileId> children_of(TileId id) {
  std::vector<TileId> all;
  for (const int dx : {0, 1})
    for (const int dy : {0, 1}) all.push_back({id.level - 1, 2 * id.x + dx, 2 * id.y + dy});
  return all;
}

/// The voxel of a level that a point is in, counted from its tile's corner.
std::tuple<long, long, long> voxel_of(const MapPoint& p, double edge_m) {
  return {static_cast<long>(std::floor(p.x / edge_m)), static_cast<long>(std::floor(p.y / edge_m)),
          static_cast<long>(std::floor(p.z / edge_m))};
}

std::shared_ptr<const MapLevels> made(const MapPackage& map, std::size_t threads = 1) {
  MapLevels::make(map, {.threads = threads});
  return MapLevels::open(map);
}

class Levels : public ::testing::Test {
 protected:
  std::shared_ptr<const MapPackage> map(const std::vector<MapPoint>& points,
                                        const MapManifest& manifest = {}) {
    return write_map(folder_.path() / ("map" + std::to_string(count_++)), points, manifest);
  }
  TemporaryFolder folder_{test::memory_folder()};
  int count_ = 0;
};

TEST_F(Levels, EveryPointOfATileIsAPointOfItsChildrenAndAloneInItsVoxel) {
  const auto town = map(scattered(130.0));
  const auto levels = made(*town);
  ASSERT_GE(levels->top(), 2U);
  for (const TileEntry& tile : levels->tiles()) {
    std::multiset<std::string> below;
    for (const TileId child : children_of(tile.id))
      for (const MapPoint& p : points_of(*town, *levels, child, tile.id)) below.insert(bytes_of(p));
    const double edge_m = MapLevels::voxel_m(town->manifest(), tile.id.level);
    std::set<std::tuple<long, long, long>> voxels;
    const std::vector<MapPoint> points = levels->points(tile.id);
    ASSERT_EQ(points.size(), tile.points);
    for (const MapPoint& p : points) {
      EXPECT_TRUE(below.contains(bytes_of(p)));
      EXPECT_TRUE(voxels.insert(voxel_of(p, edge_m)).second);
    }
  }
}

TEST_F(Levels, NoVoxelOfTheLevelBelowLosesItsPlace) {
  const auto town = map(scattered(130.0));
  const auto levels = made(*town);
  for (const TileEntry& tile : levels->tiles()) {
    const double edge_m = MapLevels::voxel_m(town->manifest(), tile.id.level);
    std::set<std::tuple<long, long, long>> wanted, found;
    for (const TileId child : children_of(tile.id))
      for (const MapPoint& p : points_of(*town, *levels, child, tile.id))
        wanted.insert(voxel_of(p, edge_m));
    for (const MapPoint& p : levels->points(tile.id)) found.insert(voxel_of(p, edge_m));
    EXPECT_EQ(wanted, found);
  }
}

TEST_F(Levels, EveryTileHasItsParentUpToTheTopAndTheTopIsSmall) {
  const auto town = map(scattered(130.0));
  const auto levels = made(*town);
  std::vector<TileId> all;
  for (const TileEntry& tile : town->tiles()) all.push_back(tile.id);
  for (const TileEntry& tile : levels->tiles()) all.push_back(tile.id);
  std::uint64_t at_top = 0;
  for (const TileId id : all) {
    if (id.level == levels->top()) {
      at_top += levels->find(id)->points;
    } else {
      EXPECT_NE(levels->find({id.level + 1, id.x >> 1, id.y >> 1}), nullptr);
    }
  }
  EXPECT_LE(at_top, MapLevels::kFewPoints);
  // Not higher than needed.
  std::uint64_t below_top = 0;
  for (const TileEntry& tile : levels->tiles())
    if (tile.id.level + 1 == levels->top()) below_top += tile.points;
  std::size_t tiles_below_top = 0;
  for (const TileId id : all) tiles_below_top += id.level + 1 == levels->top() ? 1 : 0;
  EXPECT_TRUE(below_top > MapLevels::kFewPoints || tiles_below_top > MapLevels::kFewTiles);
}

TEST_F(Levels, BoundsAreTrue) {
  const auto town = map(scattered(130.0));
  const auto levels = made(*town);
  for (const TileEntry& tile : levels->tiles()) {
    Eigen::AlignedBox3d box;
    for (const MapPoint& p : levels->points(tile.id))
      box.extend(corner_of(tile.id) + Eigen::Vector3d(p.x, p.y, p.z));
    EXPECT_EQ(box.min(), tile.from_origin().min());
    EXPECT_EQ(box.max(), tile.from_origin().max());
  }
}

TEST_F(Levels, SameBytesWithAnyNumberOfThreads) {
  const auto town = map(scattered(130.0));
  std::set<std::string> bytes;
  for (const std::size_t threads : {1U, 2U, 8U}) {
    MapLevels::make(*town, {.threads = threads});
    bytes.insert(text_of(levels_file(*town)));
  }
  EXPECT_THAT(bytes, SizeIs(1));
}

TEST_F(Levels, EmptyMapAndOnePointHaveNoLevelsButTheirOwn) {
  for (const auto& points : {std::vector<MapPoint>{}, {map_point(1, 2, 3)}}) {
    const auto small = map(points);
    const auto levels = made(*small);
    EXPECT_EQ(levels->top(), 0U);
    EXPECT_THAT(levels->tiles(), IsEmpty());
    EXPECT_THAT(levels->points({.level = 1, .x = 0, .y = 0}), IsEmpty());
  }
}

TEST_F(Levels, NegativeTilesGoToTheParentBelowThem) {
  std::vector<MapPoint> points;
  // More tiles than the top may have.
  for (int x = -10; x < 10; ++x)
    points.push_back(map_point(20.0F * static_cast<float>(x) + 5.0F, -1.0F, 0.0F));
  const auto strip = map(points);
  const auto levels = made(*strip);
  ASSERT_EQ(levels->top(), 1U);
  const TileEntry* parent = levels->find({.level = 1, .x = -1, .y = -1});
  ASSERT_NE(parent, nullptr);
  EXPECT_EQ(parent->points, 2U);
  EXPECT_LE((parent->from_origin().min() - Eigen::Vector3d(-35.0, -1.0, 0.0)).cwiseAbs().maxCoeff(),
            test::kOffByStepsM);
  EXPECT_EQ(levels->find({.level = 1, .x = 0, .y = 0}), nullptr);
}

TEST_F(Levels, FarAndHighPointsStay) {
  std::vector<MapPoint> points = {map_point(9e7F, -9e7F, 2e5F), map_point(9e7F, -9e7F, -2e5F),
                                  map_point(-9e7F, 0.0F, 0.0F)};
  for (int x = 0; x < 30; ++x) points.push_back(map_point(20.0F * static_cast<float>(x), 0, 0));
  const auto far = map(points);
  const auto levels = made(*far);
  const std::uint32_t top = levels->top();
  ASSERT_GT(top, 0U);
  const auto at = [top](float value) {
    return static_cast<std::int32_t>(std::floor(static_cast<double>(value) / kTileSizeM)) >> top;
  };
  EXPECT_EQ(levels->find({top, at(9e7F), at(-9e7F)})->points, 2U);
  EXPECT_EQ(levels->find({top, at(-9e7F), 0})->points, 1U);
}

TEST_F(Levels, PointsThatAreNotFiniteAreDropped) {
  const float none = std::numeric_limits<float>::quiet_NaN();
  const std::vector<MapPoint> points = {map_point(1, 1, 1), map_point(none, 1, 1),
                                        map_point(1, 1, std::numeric_limits<float>::infinity())};
  EXPECT_THAT(thinned_by_voxel(points, 0.2), SizeIs(1));
  EXPECT_THAT(thinned_by_voxel({points[1]}, 0.2), IsEmpty());
  EXPECT_THAT(thinned_by_voxel({}, 0.2), IsEmpty());
}

TEST_F(Levels, NearestToTheCentreStaysThenTheMostObservedThenTheFirst) {
  const MapPoint corner = map_point(0.01F, 0.01F, 0.01F, PointKind::kGround, 100);
  const MapPoint left = map_point(0.25F, 0.5F, 0.5F, PointKind::kMeasured, 2);
  const MapPoint right = map_point(0.75F, 0.5F, 0.5F, PointKind::kMeasured, 3);
  const MapPoint twin = map_point(0.5F, 0.75F, 0.5F, PointKind::kProjected, 3);
  const auto kept = thinned_by_voxel({corner, left, right, twin}, 1.0);
  ASSERT_THAT(kept, SizeIs(1));
  EXPECT_EQ(bytes_of(kept[0]), bytes_of(right));
  const auto turned = thinned_by_voxel({twin, right, left, corner}, 1.0);
  EXPECT_EQ(bytes_of(turned.at(0)), bytes_of(twin));
}

TEST_F(Levels, ThereAreNoneUntilTheyAreMade) {
  const auto town = map({map_point(1, 2, 3)});
  EXPECT_THROW((void)MapLevels::open(*town), StorageError);
  MapLevels::make(*town);
  EXPECT_NO_THROW((void)MapLevels::open(*town));
  MapLevels::remove(*town);
  EXPECT_THROW((void)MapLevels::open(*town), StorageError);
}

TEST_F(Levels, FileOfAnotherMapIsNotTaken) {
  const auto one = map(scattered(60.0, 1));
  const auto two = map(scattered(60.0, 2));
  MapLevels::make(*one);
  MapLevels::make(*two);
  fs::copy_file(levels_file(*one), levels_file(*two), fs::copy_options::overwrite_existing);
  EXPECT_THAT([&] { (void)MapLevels::open(*two); },
              ThrowsSaying<InputError>({"made from something else"}));
}

TEST_F(Levels, ChangedByteIsFoundWhereverItIs) {
  const auto town = map(scattered(60.0));
  const auto levels = made(*town);
  ASSERT_FALSE(levels->tiles().empty());
  const std::string whole = text_of(levels_file(*town));
  const auto holds = [&](const std::string& bytes) {
    std::ofstream(levels_file(*town), std::ios::binary) << bytes;
    try {
      const auto opened = MapLevels::open(*town);
      for (const TileEntry& tile : opened->tiles()) (void)opened->points(tile.id);
    } catch (const InputError&) {
      return false;
    }
    return true;
  };
  EXPECT_TRUE(holds(whole));
  const std::size_t step = whole.size() / 97;
  for (std::size_t at = 0; at < whole.size(); at += at < 300 ? 1 : step) {
    std::string changed = whole;
    changed[at] = static_cast<char>(changed[at] ^ 0x10);
    EXPECT_FALSE(holds(changed)) << at;
    EXPECT_FALSE(holds(whole.substr(0, at))) << at;
  }
  EXPECT_FALSE(holds(whole + "more"));
  MapLevels::make(*town);
  EXPECT_EQ(text_of(levels_file(*town)), whole);
}

TEST_F(Levels, WhoReadsGoesOnReadingWhenTheFileIsReplaced) {
  const auto town = map(scattered(60.0));
  const auto levels = made(*town);
  const TileId id = levels->tiles().front().id;
  const std::vector<MapPoint> before = levels->points(id);
  MapLevels::remove(*town);
  MapLevels::make(*town);
  const std::vector<MapPoint> after = levels->points(id);
  ASSERT_EQ(before.size(), after.size());
  EXPECT_EQ(std::memcmp(before.data(), after.data(), before.size() * sizeof(MapPoint)), 0);
}

TEST_F(Levels, StoppedWorkLeavesNothing) {
  const auto town = map(scattered(130.0));
  std::vector<double> shares;
  const auto go_on = [&](double share) {
    shares.push_back(share);
    return shares.size() < 3;
  };
  EXPECT_THROW(MapLevels::make(*town, {.threads = 1, .go_on = go_on}), WorkStopped);
  EXPECT_THAT(shares, SizeIs(3));
  EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end()));
  EXPECT_TRUE(fs::is_empty(town->folder() / "levels"));
}

TEST_F(Levels, WhatAKilledWriterLeftIsTakenUp) {
  const auto town = map(scattered(60.0));
  const fs::path partial = town->folder() / "levels" / ".levels.tiles.partial";
  folder_.write(partial, std::string(1'000'000, 'x'));
  const auto levels = made(*town);
  EXPECT_FALSE(fs::exists(partial));
  for (const TileEntry& tile : levels->tiles()) EXPECT_NO_THROW((void)levels->points(tile.id));
}

TEST_F(Levels, OneWriterAtATime) {
  const auto town = map(scattered(60.0));
  const auto go_on = [&](double) {
    EXPECT_THAT([&] { MapLevels::make(*town); },
                ThrowsSaying<StorageError>({"being written by another process or thread"}));
    return true;
  };
  MapLevels::make(*town, {.threads = 1, .go_on = go_on});
  EXPECT_NO_THROW((void)MapLevels::open(*town));
}

TEST_F(Levels, FolderThatCannotBeWrittenIsAnErrorThatNamesIt) {
  const auto town = map(scattered(60.0));
  std::ofstream(town->folder() / "levels") << "a file where the folder should be";
  EXPECT_THAT([&] { MapLevels::make(*town); },
              ThrowsSaying<StorageError>({(town->folder() / "levels").string()}));
}

TEST_F(Levels, DigestDoesNotKnowThem) {
  const auto town = map(scattered(60.0));
  MapLevels::make(*town);
  const auto again = MapPackage::open(town->folder());
  EXPECT_EQ(again->digest(), town->digest());
  EXPECT_THAT(again->verify(), IsEmpty());
}

TEST_F(Levels, MapThatDoesNotSayItsVoxelsCountsAsOneOfTenCentimetres) {
  MapManifest manifest;
  EXPECT_DOUBLE_EQ(MapLevels::voxel_m(manifest, 0), 0.1);
  EXPECT_DOUBLE_EQ(MapLevels::voxel_m(manifest, 3), 0.8);
  manifest.voxel_size_m = 1e-300;
  EXPECT_DOUBLE_EQ(MapLevels::voxel_m(manifest, 1), 0.002);
}

}  // namespace map_levels_test
}  // namespace stillmap::maps
