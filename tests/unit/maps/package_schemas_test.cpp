#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/content_digest.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/tile_check.hpp>
#include <stillmap/maps/tile_steps.hpp>

#include <cstdio>
#include <fstream>
#include <random>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace package_schemas_test {

namespace fs = std::filesystem;
using test::ThrowsSaying;
using ::testing::ElementsAre;

using Drives = std::vector<MapManifest::DriveCounts>;

/// Tiles on both sides of the origin and within 500 m of it, where floats of schema 1 are exact, in
/// steps, with histories of two drives.
struct World {
  std::map<TileId, std::vector<MapPoint>> tiles;
  std::map<TileId, std::vector<PointHistory>> histories;
};

World some_world() {
  World world;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> along(0.0, 20.0), height(-2.0, 50.0);
  for (const std::int32_t x : {-2, -1, 0, 24}) {
    const TileId id{.level = 0, .x = x, .y = -x};
    for (std::uint32_t i = 0; i < 40; ++i) {
      const Eigen::Vector3f p = in_steps({along(random), along(random), height(random)});
      const std::uint32_t object = i % 7 == 0 ? 600 + i : 0;
      world.tiles[id].push_back(
          {p.x(), p.y(), p.z(), in_intensity_steps(0.1F * static_cast<float>(i)),
           static_cast<std::uint16_t>(i), static_cast<PointKind>(i % 4),
           static_cast<std::uint8_t>(object == 0 ? 0 : 1 + (object - 1) % 255)});
      world.histories[id].push_back({i % 9, 4 + i % 5, object, {1, -120, 40}, 200});
    }
  }
  return world;
}

std::shared_ptr<const MapPackage> write(const fs::path& target, int schema, const World& world,
                                        const Eigen::Vector3d& origin = {20.0, -40.0, 3.0},
                                        const Drives& drives = {{4, 610}, {5, 40}}) {
  MapPackageWriter writer(target, {}, schema);
  writer.set_drives(drives);
  std::vector<MapObject> objects;
  std::size_t first_scan = 0;
  for (std::size_t drive = 0; drive < drives.size(); ++drive) {
    for (std::size_t i = 0; i < drives[drive].objects; ++i) {
      MapObject& object = objects.emplace_back();
      object.drive = drive;
      object.first_scan = object.last_scan = first_scan + i % drives[drive].scans;
      object.placements = {{object.first_scan, Eigen::Vector3d::Zero(), 0.0}};
    }
    first_scan += drives[drive].scans;
  }
  writer.write_objects(objects);
  for (const auto& [id, points] : world.tiles)
    writer.add_tile(id, MapTile(origin, {kTileSizeM * id.x, kTileSizeM * id.y, 0.0}, points),
                    world.histories.at(id));
  MapManifest manifest;
  manifest.frame_id = "map";
  manifest.origin = origin;
  manifest.voxel_size_m = 0.1;
  writer.publish(manifest, "{}");
  return MapPackage::open(target);
}

class PackageSchemas : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
  World world_ = some_world();
  std::shared_ptr<const MapPackage> first_ = write(folder_.path() / "first", 1, world_);
  std::shared_ptr<const MapPackage> second_ = write(folder_.path() / "second", 2, world_);
};

TEST_F(PackageSchemas, HoldTheSame) {
  EXPECT_EQ(first_->manifest().schema, 1);
  EXPECT_EQ(second_->manifest().schema, 2);
  EXPECT_EQ(content_digest(*first_), content_digest(*second_));
  const std::vector<TileEntry> first = first_->tiles(), second = second_->tiles();
  ASSERT_EQ(first.size(), second.size());
  EXPECT_EQ(first_->manifest().extent.tiles, first.size());
  EXPECT_EQ(second_->manifest().extent.tiles, first.size());
  EXPECT_EQ(first_->manifest().extent.points, second_->manifest().extent.points);
  EXPECT_NEAR(first_->manifest().extent.area_m2, second_->manifest().extent.area_m2, 1e-3);
  EXPECT_EQ(first_->regions(), second_->regions());
  for (std::size_t i = 0; i < first.size(); ++i) {
    const TileEntry& one = first[i];
    const TileEntry& other = second[i];
    EXPECT_EQ(one.id, other.id);
    EXPECT_EQ(one.points, other.points);
    EXPECT_LT((one.from_origin().min() - other.from_origin().min()).norm(), 1e-5);
    EXPECT_LT((one.from_origin().max() - other.from_origin().max()).norm(), 1e-5);
    EXPECT_TRUE(second_->has_tile(one.id));
    EXPECT_TRUE(second_->has_history(one.id));
    const auto before = first_->history(one.id), after = second_->history(one.id);
    ASSERT_EQ(before.size(), after.size());
    for (std::size_t k = 0; k < before.size(); ++k) {
      EXPECT_EQ(before[k].first_scan, after[k].first_scan);
      EXPECT_EQ(before[k].last_scan, after[k].last_scan);
      EXPECT_EQ(before[k].object, after[k].object);
      EXPECT_EQ(before[k].normal[1], after[k].normal[1]);
    }
  }
  EXPECT_FALSE(second_->has_tile({.level = 0, .x = 7, .y = 7}));
  EXPECT_TRUE(second_->tile({.level = 0, .x = 7, .y = 7}).empty());
  EXPECT_FALSE(second_->has_history({.level = 0, .x = 7, .y = 7}));
}

TEST_F(PackageSchemas, TheSecondIsExactFarFromTheOrigin) {
  World far;
  for (auto& [id, points] : world_.tiles) {
    const TileId moved{.level = 0, .x = id.x + 50'000, .y = id.y - 50'000};
    far.tiles[moved] = points;
    far.histories[moved] = world_.histories[id];
  }
  const auto map = write(folder_.path() / "far", 2, far);
  for (const auto& [id, points] : far.tiles) {
    const MapTile tile = map->tile(id);
    ASSERT_EQ(tile.size(), points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d expected =
          Eigen::Vector3d(20.0 + kTileSizeM * id.x, -40.0 + kTileSizeM * id.y, 3.0) +
          Eigen::Vector3d(points[i].x, points[i].y, points[i].z);
      EXPECT_LT((tile.position(tile[i]) - expected).norm(), 1e-9);
    }
  }
}

TEST_F(PackageSchemas, DamageIsNamedByTileAndPack) {
  const TileId id = world_.tiles.begin()->first;
  const auto [sha256, name] = second_->stored_name(id);
  const std::string pack = name.substr(0, name.find(','));
  EXPECT_EQ(sha256_of(std::string(reinterpret_cast<const char*>(second_->stored_tile(id).data()),
                                  second_->stored_tile(id).size())),
            sha256);
  EXPECT_TRUE(second_->verify().empty());
  EXPECT_NO_THROW(require_whole_tile(*second_, id));
  std::fstream file(pack, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(60);
  file.put('\x55');
  file.close();
  EXPECT_THAT(second_->verify(), ElementsAre("packs/" + fs::path(pack).filename().string()));
  EXPECT_THAT([&] { require_whole_tile(*second_, id); },
              (ThrowsSaying<InputError>({pack, "tile -2, 2", "copy or build the map again"})));
}

TEST_F(PackageSchemas, ScansOfNoDriveAreRefused) {
  World world = some_world();
  world.histories.begin()->second[0].last_scan = 9;
  EXPECT_THROW((void)write(folder_.path() / "beyond", 2, world), std::invalid_argument);
  std::string text;
  {
    std::ifstream file(folder_.path() / "second/manifest.json");
    text.assign(std::istreambuf_iterator<char>(file), {});
  }
  text.replace(text.find("\"scans\": 4"), 10, "\"scans\": 3");
  std::ofstream(folder_.path() / "second/manifest.json") << text;
  const auto map = MapPackage::open(folder_.path() / "second");
  EXPECT_THAT([&] { (void)map->history(world_.tiles.begin()->first); },
              (ThrowsSaying<InputError>({"of drive", "drives"})));
}

TEST_F(PackageSchemas, WhatTheManifestSaysOfTilesAndDrivesIsChecked) {
  const fs::path file = second_->folder() / "manifest.json";
  std::string text;
  {
    std::ifstream stream(file);
    text.assign(std::istreambuf_iterator<char>(stream), {});
  }
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string other = text;
    const std::size_t at = other.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    std::ofstream(file) << other.replace(at, from.size(), to);
    return second_->folder();
  };
  const auto wrong = MapPackage::open(changed("\"points\": 160", "\"points\": 161"));
  EXPECT_EQ(wrong->manifest().extent.points, 161U);
  EXPECT_THAT([&] { (void)wrong->tiles(); },
              (ThrowsSaying<InputError>({"161 points", "160 points", "as in the regions"})));
  const auto refused = [&](const std::string& from, const std::string& to, const char* what) {
    EXPECT_THAT([&] { (void)MapPackage::open(changed(from, to)); },
                (ThrowsSaying<InputError>({"manifest.json", what})));
  };
  refused("\"drives\"", "\"others\"", "drives");
  refused("\"extent\"", "\"others\"", "extent");
  refused("\"scans\": 5", "\"scans\": 4294967292", "scans");
  refused("\"points\": 160", "\"points\": 18446744073709551615", "points");
  refused("\"max\": [", "\"max\": [-1e300, 0, 0], \"unused\": [", "max");
}

TEST_F(PackageSchemas, ObjectsThatWereToldOfMustBeWritten) {
  MapPackageWriter writer(folder_.path() / "none");
  writer.set_drives({{4, 1}});
  const MapPoint point{1.0F, 1.0F, 1.0F, 0.0F, 1, PointKind::kMeasured, 0};
  writer.add_tile({}, std::span(&point, 1));
  EXPECT_THROW(writer.publish({}, "{}"), std::invalid_argument);
  MapObject object;
  object.drive = 1;
  object.placements = {{0, Eigen::Vector3d::Zero(), 0.0}};
  EXPECT_THROW(writer.write_objects({object}), std::invalid_argument);
  EXPECT_THROW(writer.add_fates({{PointFate::kProjected}, {2}}), std::invalid_argument);
  const TileEvidence evidence{.base_m = 0, .drives = {{1, {}, {}}}};
  EXPECT_THROW(writer.add_tile({.level = 0, .x = 3, .y = 0},
                               MapTile(Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(), {point}),
                               {}, evidence),
               std::invalid_argument)
      << "there is one drive";
}

TEST_F(PackageSchemas, TilesOfOtherVersionsAreShared) {
  World world = some_world();
  world.tiles.rbegin()->second[0].observations += 1;
  const auto other = write(folder_.path() / "other", 2, world);
  std::size_t shared = 0;
  for (const auto& [path, file] : second_->manifest().files) {
    const auto same = other->manifest().files.find(path);
    shared += same != other->manifest().files.end() && same->second.sha256 == file.sha256 ? 1 : 0;
  }
  // Three regions of a node and a pack each; one of them has changed.
  EXPECT_EQ(second_->manifest().files.size(), shared + 2);
}

TEST_F(PackageSchemas, WhatOtherDrivesAddLeavesTilesAndFilesOfADriveAlone) {
  // The first drive has more scans and objects now, and a third one came.
  World world = some_world();
  for (auto& [id, history] : world.histories) {
    for (std::size_t i = 0; i < history.size(); ++i) {
      if (history[i].object > 610) history[i].object += 100;
      for (std::uint32_t* scan : {&history[i].first_scan, &history[i].last_scan})
        *scan += *scan >= 4 ? 3 : 0;
    }
  }
  const auto other =
      write(folder_.path() / "other", 2, world, {20.0, -40.0, 3.0}, {{7, 710}, {5, 40}, {6, 2}});
  std::size_t of_tiles = 0;
  for (const auto& [path, file] : second_->manifest().files) {
    if (path == "objects.json") continue;
    EXPECT_EQ(other->manifest().files.at(path).sha256, file.sha256) << path;
    of_tiles += path.ends_with(".pack") || path.ends_with(".node") ? 1 : 0;
  }
  EXPECT_EQ(of_tiles, 6U);
  const TileId id = world.tiles.begin()->first;
  EXPECT_EQ(other->history(id)[14].object, 714U);
  EXPECT_EQ(other->objects().at(713).drive, 1U);
}

}  // namespace package_schemas_test
}  // namespace stillmap::maps
