#include "package/tile_packs.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <fstream>
#include <map>
#include <random>
#include <set>
#include <utility>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace tile_packs_test {

namespace fs = std::filesystem;
using test::ThrowsSaying;
using ::testing::HasSubstr;

TileContent tile_of(TileId id) {
  std::mt19937 random(static_cast<unsigned>(1000 * id.x + id.y));
  std::uniform_real_distribution<float> along(0.0F, 20.0F);
  TileContent tile;
  tile.z_base_m = id.y;
  for (int i = 0; i < 50; ++i)
    tile.points.push_back(
        {along(random), along(random), along(random), 1.0F, 3, PointKind::kMeasured, 0});
  return tile;
}

std::vector<TileId> some_tiles() {
  std::vector<TileId> tiles;
  for (const std::int32_t x : {-33, -32, -1, 0, 31, 32})
    for (const std::int32_t y : {-1, 0, 40}) tiles.push_back({.level = 0, .x = x, .y = y});
  return tiles;
}

std::map<std::string, std::string> contents(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    std::ifstream file(entry.path(), std::ios::binary);
    files[entry.path().lexically_relative(folder).string()].assign(
        std::istreambuf_iterator<char>(file), {});
  }
  return files;
}

std::map<std::string, MapManifest::File> write(const fs::path& folder,
                                               const std::vector<TileId>& tiles) {
  PackWriter writer(folder);
  for (const TileId& id : tiles) writer.add(id, tile_of(id));
  EXPECT_EQ(writer.finish().size(), tiles.size());
  std::map<std::string, MapManifest::File> files;
  for (const auto& [path, bytes] : contents(folder)) files[path].bytes = bytes.size();
  return files;
}

TEST(TilePacks, RegionsCountFromZeroDownwardsToo) {
  EXPECT_EQ(region_of({0, 31, 0}), (RegionId{0, 0}));
  EXPECT_EQ(region_of({0, 32, -1}), (RegionId{1, -1}));
  EXPECT_EQ(region_of({0, -32, -33}), (RegionId{-1, -2}));
}

TEST(TilePacks, GiveTilesBack) {
  const test::TemporaryFolder folder;
  const PackReader reader(folder.path(), write(folder.path(), some_tiles()));
  std::size_t tiles = 0;
  for (const RegionId region : reader.regions()) {
    const std::vector<TileEntry> own = reader.tiles(region);
    tiles += own.size();
    EXPECT_TRUE(std::is_sorted(own.begin(), own.end(),
                               [](const auto& a, const auto& b) { return a.id < b.id; }));
  }
  EXPECT_EQ(tiles, some_tiles().size());
  EXPECT_TRUE(reader.tiles(RegionId{100, 100}).empty());
  for (const TileId& id : some_tiles()) {
    const TileContent tile = decode_tile(reader.bytes(id), "tile");
    EXPECT_EQ(encode_tile(tile), encode_tile(tile_of(id)));
    EXPECT_EQ(tile.z_base_m, id.y);
    const RegionTile* const row = reader.find(id);
    ASSERT_NE(row, nullptr);
    EXPECT_EQ(row->points, tile.points.size());
    for (const MapPoint& p : tile.points) {
      EXPECT_GE(p.x, row->min_xy[0] * kTileStepM);
      EXPECT_LE(p.x, (row->max_xy[0] + 1) * kTileStepM);
      EXPECT_GE(p.z, row->min_z * kTileStepZM);
      EXPECT_LE(p.z, (row->max_z + 1) * kTileStepZM);
    }
    EXPECT_THAT(reader.name_of(id), HasSubstr(".pack, tile " + std::to_string(id.x)));
  }
  EXPECT_EQ(reader.find({.level = 0, .x = 5, .y = 5}), nullptr);
  EXPECT_TRUE(reader.bytes({.level = 0, .x = 5, .y = 5}).empty());
}

TEST(TilePacks, DoNotTellTheOrderInWhichTilesCame) {
  const test::TemporaryFolder one, other;
  write(one.path(), some_tiles());
  std::vector<TileId> tiles = some_tiles();
  std::mt19937 random(1);
  std::shuffle(tiles.begin(), tiles.end(), random);
  write(other.path(), tiles);
  EXPECT_EQ(contents(one.path()), contents(other.path()));
  EXPECT_EQ(contents(one.path()).size(), 2U * 12);
}

TEST(TilePacks, LeaveOtherRegionsAloneWhenATileChanges) {
  const test::TemporaryFolder one, other;
  write(one.path(), some_tiles());
  std::vector<TileId> fewer = some_tiles();
  fewer.pop_back();
  write(other.path(), fewer);
  const auto before = contents(one.path()), after = contents(other.path());
  std::size_t shared = 0;
  for (const auto& [name, bytes] : after)
    shared += before.contains(name) && before.at(name) == bytes ? 1 : 0;
  EXPECT_EQ(shared, after.size());
  EXPECT_EQ(before.size(), after.size() + 2);
}

TEST(TilePacks, NamePacksThatAreMissingOrOfAnotherSize) {
  const test::TemporaryFolder folder;
  const auto files = write(folder.path(), some_tiles());
  const TileId id = some_tiles().front();
  std::string pack;
  {
    const PackReader reader(folder.path(), files);
    const std::string name = reader.name_of(id);
    pack = name.substr(0, name.find(','));
  }
  fs::resize_file(pack, fs::file_size(pack) - 1);
  const std::string listed = fs::path(pack).lexically_relative(folder.path()).string();
  const PackReader cut(folder.path(), files);
  EXPECT_THAT([&] { (void)cut.find(id); },
              (ThrowsSaying<InputError>({".node", "bytes in " + listed, "copy or build"})));
  auto fewer = files;
  fewer.erase(listed);
  const PackReader unlisted(folder.path(), fewer);
  EXPECT_THAT([&] { (void)unlisted.find(id); },
              (ThrowsSaying<InputError>({".node", "bytes in " + listed})));
  // Twice the same.
  EXPECT_THROW((void)unlisted.find(id), InputError);
  fs::remove(pack);
  EXPECT_THAT([&] { const PackReader gone(folder.path(), files); },
              (ThrowsSaying<StorageError>({pack})));
}

TEST(TilePacks, RefuseNodesWithoutTiles) {
  const test::TemporaryFolder folder;
  auto files = write(folder.path(), some_tiles());
  for (const char* path : {"regions/67108864_0.node", "regions/0_-67108865.node", "regions/x"}) {
    auto more = files;
    more[path].bytes = 16;
    EXPECT_THAT([&] { const PackReader reader(folder.path(), more); },
                (ThrowsSaying<InputError>({path, "X_Y.node"})));
  }
  EXPECT_TRUE(region_of_path("regions/-67108864_67108863.node"));
}

TEST(TilePacks, ReadNoRegionThatNobodyAsksFor) {
  const test::TemporaryFolder folder;
  const auto files = write(folder.path(), some_tiles());
  const TileId broken = some_tiles().front(), whole = some_tiles().back();
  ASSERT_NE(region_of(broken), region_of(whole));
  std::ofstream(folder.path() / region_path(region_of(broken))) << "no node";
  const PackReader reader(folder.path(), files);
  EXPECT_FALSE(reader.bytes(whole).empty());
  EXPECT_THROW((void)reader.bytes(broken), InputError);
}

TEST(TilePacks, StayReadableWhenThePackageIsRemoved) {
  test::TemporaryFolder folder;
  const PackReader reader(folder.path(), write(folder.path(), some_tiles()));
  fs::remove_all(folder.path() / "packs");
  const TileId id = some_tiles().back();
  EXPECT_EQ(encode_tile(decode_tile(reader.bytes(id), "tile")), encode_tile(tile_of(id)));
}

TEST(TilePacks, PathsOfRegionsAreSpelledInOneWay) {
  EXPECT_EQ(region_of_path("regions/-3_0.node"), (RegionId{-3, 0}));
  for (const char* path : {"regions/-3_0.nodes", "regions/+3_0.node", "regions/03_0.node",
                           "regions/3_.node", "region/3_0.node", "regions/3_0", ""})
    EXPECT_EQ(region_of_path(path), std::nullopt) << path;
}

TEST(TilePacks, RefuseATileTwiceAndOtherLevels) {
  const test::TemporaryFolder folder;
  PackWriter writer(folder.path());
  const TileId id{.level = 0, .x = 1, .y = 1};
  writer.add(id, tile_of(id));
  EXPECT_THROW(writer.add(id, tile_of(id)), std::invalid_argument);
  EXPECT_THROW(writer.add({.level = 1, .x = 0, .y = 0}, tile_of(id)), std::invalid_argument);
}

/// A package in which some tiles of another one are left out and one is new.
struct TakenOver {
  explicit TakenOver(const fs::path& folder) : before(folder / "before"), after(folder / "after") {
    files = write(before, some_tiles());
    const PackReader reader(before, files);
    PackWriter writer(after);
    TileContent changed = tile_of(kChanged);
    changed.points.resize(10);
    writer.take_over(reader, {kChanged, kGone});
    writer.add(kChanged, changed);
    EXPECT_EQ(writer.finish().size(), some_tiles().size() - 1);
    for (const auto& [path, bytes] : contents(after)) files_after[path].bytes = bytes.size();
  }
  static constexpr TileId kChanged{0, 0, 0}, kGone{0, 31, -1};
  fs::path before, after;
  std::map<std::string, MapManifest::File> files, files_after;
};

TEST(TilePacks, TakeOverTilesAsTheyAre) {
  const test::TemporaryFolder folder;
  const TakenOver taken(folder.path());
  const PackReader before(taken.before, taken.files), after(taken.after, taken.files_after);
  for (const TileId& id : some_tiles()) {
    if (id == TakenOver::kChanged) {
      EXPECT_EQ(decode_tile(after.bytes(id), "tile").points.size(), 10U);
    } else if (id == TakenOver::kGone) {
      EXPECT_EQ(after.find(id), nullptr);
    } else {
      ASSERT_NE(after.find(id), nullptr);
      EXPECT_EQ(after.find(id)->sha256, before.find(id)->sha256);
      EXPECT_TRUE(std::ranges::equal(after.bytes(id), before.bytes(id)));
    }
  }
}

TEST(TilePacks, TakeNoRoomForWhatIsTakenOver) {
  const test::TemporaryFolder folder;
  const TakenOver taken(folder.path());
  const auto before = contents(taken.before), after = contents(taken.after);
  std::size_t same = 0, others = 0;
  for (const auto& [path, bytes] : after) {
    const auto found = before.find(path);
    const bool is_same = found != before.end() && found->second == bytes;
    same += is_same ? 1 : 0;
    others += is_same ? 0 : 1;
    if (is_same && path.starts_with("packs/")) {
      EXPECT_TRUE(fs::equivalent(taken.before / path, taken.after / path));
    }
  }
  // Of the changed region of 0, 0 and of that without a tile the nodes; the pack of the new tile.
  EXPECT_EQ(others, 3U);
  EXPECT_EQ(same, before.size() - 2);
}

/// Bytes of all files of a folder.
std::size_t bytes_in(const fs::path& folder) {
  std::size_t sum = 0;
  for (const auto& [path, bytes] : contents(folder)) sum += bytes.size();
  return sum;
}

/// Ten tiles of one region.
std::vector<TileId> row_of_tiles() {
  std::vector<TileId> tiles;
  for (std::int32_t x = 0; x < 10; ++x) tiles.push_back({.level = 0, .x = x, .y = 0});
  return tiles;
}

TEST(TilePacks, WriteWhatRemainsOfAPackAgainWhenLessThanHalfIsTakenOver) {
  const test::TemporaryFolder folder;
  const auto tiles = row_of_tiles();
  const fs::path before = folder.path() / "before";
  const PackReader reader(before, write(before, tiles));
  for (const std::size_t changed : {4U, 6U}) {
    const fs::path after = folder.path() / std::to_string(changed);
    PackWriter writer(after);
    const std::set<TileId> except(tiles.begin(), tiles.begin() + changed);
    writer.take_over(reader, except);
    for (const TileId& id : except) writer.add(id, tile_of({0, id.x + 100, 0}));
    EXPECT_EQ(writer.finish().size(), tiles.size());
    std::map<std::string, MapManifest::File> files;
    for (const auto& [path, bytes] : contents(after)) files[path].bytes = bytes.size();
    EXPECT_EQ(files.size(), changed == 4 ? 3U : 2U) << "a node and its packs";
    const PackReader patched(after, files);
    for (const TileId& id : tiles) {
      const TileId is = except.contains(id) ? TileId{0, id.x + 100, 0} : id;
      EXPECT_TRUE(std::ranges::equal(patched.bytes(id), encode_tile(tile_of(is)))) << id.x;
    }
    // Made at once, it is the same.
    if (changed == 6) {
      PackWriter at_once(folder.path() / "at_once");
      for (const TileId& id : tiles)
        at_once.add(id, tile_of(except.contains(id) ? TileId{0, id.x + 100, 0} : id));
      (void)at_once.finish();
      EXPECT_EQ(contents(after), contents(folder.path() / "at_once"));
    }
  }
}

TEST(TilePacks, StayWithinTwiceTheirTilesHoweverOftenTheyArePatched) {
  const test::TemporaryFolder folder;
  const auto tiles = row_of_tiles();
  fs::path at = folder.path() / "0";
  auto files = write(at, tiles);
  const std::size_t first = bytes_in(at);
  for (std::int32_t round = 1; round <= 30; ++round) {
    const fs::path next = folder.path() / std::to_string(round);
    const PackReader reader(at, files);
    PackWriter writer(next);
    const TileId changed = tiles[static_cast<std::size_t>(7 * round % 10)];
    writer.take_over(reader, {changed});
    writer.add(changed, tile_of({0, changed.x + 100 * round, 0}));
    (void)writer.finish();
    files.clear();
    for (const auto& [path, bytes] : contents(next)) files[path].bytes = bytes.size();
    EXPECT_LT(bytes_in(next), 2.2 * static_cast<double>(first)) << round;
    at = next;
  }
}

TEST(TilePacks, TakeOverAPatchAgainAndForgetPacksThatNoTileIsIn) {
  const test::TemporaryFolder folder;
  const TakenOver taken(folder.path());
  const PackReader patched(taken.after, taken.files_after);
  const auto again = [&](const std::string& name, std::set<TileId> except) {
    PackWriter writer(folder.path() / name);
    writer.take_over(patched, std::move(except));
    (void)writer.finish();
    return contents(folder.path() / name);
  };
  EXPECT_EQ(again("all", {}), contents(taken.after));
  const auto without = again("without", {TakenOver::kChanged});
  EXPECT_EQ(without.size(), contents(taken.after).size() - 1);
}

}  // namespace tile_packs_test
}  // namespace stillmap::maps
