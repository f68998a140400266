#include "index/index_file.hpp"
#include "index/index_format.hpp"
#include "index/index_grid.hpp"
#include "index/index_window.hpp"
#include "index/map_level.hpp"
#include "index/voxel_build.hpp"
#include "reference/map_points.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/index_voxels.hpp>
#include <support/synthetic_world.hpp>
#include <support/temporary_folder.hpp>

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace stillmap::localization {
namespace index_file_test {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// A rough street along x: ground 10 m wide and a wall beside it, some six points a fine voxel.
std::vector<maps::MapPoint> street(double length_m, std::uint64_t seed = 7) {
  test::Random random(seed);
  std::vector<maps::MapPoint> points;
  const auto add = [&](double x, double y, double z) {
    points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z), 0.0F,
                      static_cast<std::uint16_t>(1 + random.uniform(0.0, 9.0)),
                      maps::PointKind::kMeasured, 0});
  };
  for (int k = 0; k < static_cast<int>(length_m * 10 * 24); ++k) {
    add(random.uniform(0.0, length_m), random.uniform(0.0, 10.0), 0.02 * random.normal());
  }
  for (int k = 0; k < static_cast<int>(length_m * 4 * 24); ++k) {
    add(random.uniform(0.0, length_m), 10.0 + 0.02 * random.normal(), random.uniform(0.0, 4.0));
  }
  return points;
}

/// Of schema 1, whose tiles may hold any float.
fs::path write_map(const fs::path& folder, const std::vector<maps::MapPoint>& points) {
  maps::MapPackageWriter writer(folder, {}, 1);
  std::map<maps::TileId, std::vector<maps::MapPoint>> tiles;
  for (const maps::MapPoint& p : points) {
    const auto tile = [](float c) {
      return static_cast<std::int32_t>(std::floor(static_cast<double>(c) / maps::kTileSizeM));
    };
    tiles[{.level = 0, .x = tile(p.x), .y = tile(p.y)}].push_back(p);
  }
  for (const auto& [id, some] : tiles) writer.add_tile(id, some);
  maps::MapManifest manifest;
  manifest.frame_id = "map";
  manifest.origin = Eigen::Vector3d(500.0, -200.0, 30.0);
  manifest.voxel_size_m = 0.1;
  manifest.software_version = "0";
  (void)writer.publish(manifest, "{}");
  return folder;
}

std::string bytes_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

void put(const fs::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
}

/// Whether one point is hit.
unsigned hit(const CellBits& bits, const Eigen::Vector3f& p) {
  PointColumns one(1);
  one.set(0, p);
  return bits.hits(one, Eigen::Vector3f::Zero());
}

/// In or beside the first metres of the street. @param length_m  of these.
Eigen::Vector3f some_point(test::Random& random, double length_m = 30.0) {
  return {static_cast<float>(random.uniform(-2.0, length_m + 2.0)),
          static_cast<float>(random.uniform(-2.0, 12.0)),
          static_cast<float>(random.uniform(-2.0, 6.0) + below_origin_m({}))};
}

void expect_same(const MapIndex& a, const MapIndex& b) {
  EXPECT_EQ(a.origin(), b.origin());
  EXPECT_TRUE(a.bounds().isApprox(b.bounds(), 0.0));
  EXPECT_EQ(a.voxel_count(), b.voxel_count());
  const auto window_a = test::window_of(a);
  const auto window_b = test::window_of(b);
  EXPECT_EQ(window_a->origin(), window_b->origin());
  for (std::size_t k = 0; k < kPlaceGridEdgesM.size(); ++k) {
    test::Random random(k);
    unsigned hits = 0;
    for (int n = 0; n < 2000; ++n) {
      const Eigen::Vector3f p = some_point(random);
      const unsigned here = hit(window_a->place_grids()[k], p);
      ASSERT_EQ(here, hit(window_b->place_grids()[k], p));
      hits += here;
    }
    EXPECT_GT(hits, 200U);
  }
  ASSERT_EQ(window_a->levels().size(), window_b->levels().size());
  for (std::size_t k = 0; k < window_a->levels().size(); ++k) {
    const MapIndex::Level& one = window_a->levels()[k];
    const MapIndex::Level& other = window_b->levels()[k];
    EXPECT_EQ(one.edge_m, other.edge_m);
    const auto ones = test::voxels_of(one);
    const auto others = test::voxels_of(other);
    ASSERT_EQ(ones.size(), others.size());
    for (std::size_t i = 0; i < ones.size(); ++i)
      ASSERT_EQ(std::memcmp(ones[i].voxel, others[i].voxel, sizeof(Voxel)), 0);
    test::Random random(k);
    for (int n = 0; n < 2000; ++n) {
      const Eigen::Vector3f p = some_point(random);
      const MapIndex::Level::Nearest x = one.nearest(p, 0.01F);
      const MapIndex::Level::Nearest y = other.nearest(p, 0.01F);
      ASSERT_EQ(x.voxel == nullptr, y.voxel == nullptr);
      ASSERT_EQ(x.mean, y.mean);
      ASSERT_EQ(x.distance2, y.distance2);
    }
  }
}

class IndexFile : public ::testing::Test {
 protected:
  [[nodiscard]] std::shared_ptr<const MapIndex> open() const { return MapIndex::open(*map_); }
  [[nodiscard]] fs::path file() const { return root_file_of(map_->folder(), {}); }
  [[nodiscard]] fs::path region_file() const { return region_file_of(map_->folder(), {}, {}); }
  /// Of the region's file.
  [[nodiscard]] IndexKey key() const {
    const auto index = open();
    const auto& source = index->root().regions.front().source;
    return {std::string(source.begin(), source.end()), {}};
  }

  test::TemporaryFolder folder_;
  std::shared_ptr<const maps::MapPackage> map_ =
      maps::MapPackage::open(write_map(folder_.path() / "map", street(30.0)));
};

TEST_F(IndexFile, MappedOrBuiltTheAnswersAreTheSameToTheLastBit) {
  const auto built = MapIndex::build(*map_);
  EXPECT_THAT(built->file().string(), IsEmpty());
  EXPECT_FALSE(fs::exists(file()));
  const auto written = open();
  EXPECT_THAT(written->rebuilt_because(), HasSubstr("No such file"));
  EXPECT_EQ(written->file(), file());
  const auto mapped = open();
  EXPECT_THAT(mapped->rebuilt_because(), IsEmpty());
  EXPECT_THAT(mapped->kept_in_memory_because(), IsEmpty());
  EXPECT_EQ(mapped->file(), file());
  expect_same(*built, *written);
  expect_same(*built, *mapped);
  mapped->verify();
}

TEST_F(IndexFile, IsNoPartOfTheMapsDigest) {
  (void)open();
  const auto again = maps::MapPackage::open(map_->folder());
  EXPECT_EQ(again->digest(), map_->digest());
  EXPECT_THAT(again->verify(), IsEmpty());
}

TEST_F(IndexFile, OtherOptionsHaveTheirOwnFile) {
  MapIndexOptions coarse;
  coarse.finest_voxel_m = 1.0;
  const auto fine = open();
  const auto other = MapIndex::open(*map_, coarse);
  EXPECT_NE(fine->file(), other->file());
  EXPECT_THAT(open()->rebuilt_because(), IsEmpty());
  EXPECT_EQ(test::window_of(*MapIndex::open(*map_, coarse))->levels().back().edge_m, 1.0F);
  MapIndexOptions broken;
  broken.levels = 0;
  EXPECT_THROW((void)MapIndex::open(*map_, broken), std::invalid_argument);
}

TEST_F(IndexFile, IsRefusedByNameAndMadeAnewWhenItIsNotTheOneWanted) {
  const std::string good = bytes_of(open()->file());
  const auto other_map =
      maps::MapPackage::open(write_map(folder_.path() / "other", street(30.0, 8)));
  MapIndexOptions coarse;
  coarse.min_points = 6;
  const auto with = [&](std::size_t at, char value) {
    std::string changed = good;
    changed[at] = value;
    return changed;
  };
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"", "found 0 bytes"},
      {good.substr(0, 100), "found 100 bytes"},
      {good.substr(0, good.size() - 64), "expected " + std::to_string(good.size())},
      {good + std::string(64, '\0'), "expected " + std::to_string(good.size())},
      {with(0, 'x'), "another kind of file"},
      {with(8, 2), "found format 2, expected format 3"},
      {with(100, 'x'), "checksum"},
      {bytes_of(MapIndex::open(*other_map)->file()), "an index of "},
      {bytes_of(MapIndex::open(*map_, coarse)->file()), "at least 6 points"},
  };
  for (const auto& [bytes, reason] : cases) {
    put(file(), bytes);
    const auto index = open();
    EXPECT_THAT(index->rebuilt_because(), HasSubstr(reason));
    EXPECT_THAT(index->rebuilt_because(), HasSubstr(file().string()));
    EXPECT_EQ(index->file(), file()) << reason;
    EXPECT_EQ(bytes_of(file()), good) << reason;
    EXPECT_THAT(open()->rebuilt_because(), IsEmpty());
  }
}

TEST_F(IndexFile, ARegionThatIsBrokenOrGoneIsBuiltAgainWhenAQueryComes) {
  const auto built = MapIndex::build(*map_);
  (void)open();
  const std::string good = bytes_of(region_file());
  for (const std::string& bytes : {std::string(), good.substr(0, good.size() - 64)}) {
    put(region_file(), bytes);
    const auto index = open();
    EXPECT_THAT(index->rebuilt_because(), IsEmpty());
    expect_same(*index, *built);
    EXPECT_EQ(bytes_of(region_file()), good);
  }
  fs::remove(region_file());
  expect_same(*open(), *built);
  EXPECT_EQ(bytes_of(region_file()), good);
}

TEST_F(IndexFile, ARegionWhoseTilesAreAsTheyWereKeepsItsFile) {
  (void)open();
  const auto written = fs::last_write_time(region_file());
  fs::remove(file());
  EXPECT_THAT(open()->rebuilt_because(), HasSubstr("No such file"));
  EXPECT_EQ(fs::last_write_time(region_file()), written);
}

/// Where the directories end: all of a region that is read when it is opened.
std::size_t bytes_read_at_load(const std::string& good) {
  std::size_t end = 0;
  maps::SectionHeader header;
  std::memcpy(&header, good.data(), sizeof(header));
  for (std::size_t k = 0; k < header.sections; ++k) {
    maps::Section section;
    std::memcpy(&section, good.data() + sizeof(header) + k * sizeof(section), sizeof(section));
    const auto kind = static_cast<index_format::Kind>(section.kind);
    const bool directory =
        kind == index_format::Kind::kTiles || kind == index_format::Kind::kGridTiles;
    if (directory) end = std::max<std::size_t>(end, section.offset + section.bytes);
  }
  return end;
}

/// Bytes as a view wants them.
struct Aligned {
  explicit Aligned(const std::string& text) : lines(text.size() / sizeof(CacheLine)) {
    std::memcpy(lines.data(), text.data(), lines.size() * sizeof(CacheLine));
  }
  [[nodiscard]] std::span<std::byte> bytes() { return std::as_writable_bytes(std::span(lines)); }
  std::vector<CacheLine> lines;
};

TEST_F(IndexFile, NoBitOfWhatIsReadAtLoadFlipsUnseen) {
  const IndexKey wanted = key();
  const std::string good = bytes_of(region_file());
  const std::size_t end = bytes_read_at_load(good);
  ASSERT_GT(end, sizeof(maps::SectionHeader));
  Aligned aligned(good);
  const std::span<std::byte> bytes = aligned.bytes();
  (void)region_view(bytes, wanted, "x");
  std::size_t unseen = 0;
  for (std::size_t at = 0; at < end; ++at) {
    bytes[at] ^= std::byte{1} << (at % 8);
    try {
      (void)region_view(bytes, wanted, "x");
      ++unseen;
    } catch (const maps::InputError&) {
    }
    bytes[at] ^= std::byte{1} << (at % 8);
  }
  // Only the zeros between two sections.
  EXPECT_LT(unseen, 7 * index_format::kAlignment);
}

TEST_F(IndexFile, DamageBehindTheHeaderIsFoundByVerifyAndReachesNothingOutside) {
  (void)open();
  const std::string good = bytes_of(region_file());
  test::Random random(5);
  for (int round = 0; round < 30; ++round) {
    std::string damaged = good;
    for (int k = 0; k < 200; ++k) {
      const auto at = static_cast<std::size_t>(random.uniform(
          static_cast<double>(bytes_read_at_load(good)), static_cast<double>(good.size())));
      damaged[at] = static_cast<char>(random.uniform(-128.0, 128.0));
    }
    put(region_file(), damaged);
    const auto index = open();
    EXPECT_THAT(index->rebuilt_because(), IsEmpty());
    EXPECT_THROW(index->verify(), maps::InputError);
    const auto window = test::window_of(*index);
    for (const CellBits& grid : window->place_grids()) {
      for (float x = -2.0F; x < 40.0F; x += 0.5F) (void)hit(grid, {x, 0.3F * x, 1.0F});
    }
    // The sanitizer sees what reaches outside.
    for (const MapIndex::Level& level : window->levels()) {
      (void)test::voxels_of(level);
      for (int n = 0; n < 3000; ++n) (void)level.nearest(some_point(random), 0.01F);
    }
  }
}

/// The parts of an index file that somebody changes on purpose.
struct Forged {
  explicit Forged(const std::string& good) : bytes(good) {
    std::memcpy(&header, bytes.data(), sizeof(header));
    about = header.read_about<index_format::About>();
    sections.resize(header.sections);
    std::memcpy(sections.data(), bytes.data() + sizeof(header),
                sections.size() * sizeof(sections[0]));
  }
  /// With a checksum that fits.
  [[nodiscard]] std::string sealed() {
    header.set_about(about);
    header.crc = 0;
    header.crc = maps::crc32c(std::as_bytes(std::span(sections).first(header.sections)),
                              maps::crc32c(std::as_bytes(std::span(&header, 1))));
    std::memcpy(bytes.data(), &header, sizeof(header));
    std::memcpy(bytes.data() + sizeof(header), sections.data(),
                sections.size() * sizeof(sections[0]));
    return bytes;
  }

  std::string bytes;
  maps::SectionHeader header;
  index_format::About about;
  std::vector<maps::Section> sections;
};

/// What a region is refused for; empty when it is taken.
std::string refusal_of(const std::string& bytes, const IndexKey& key) {
  try {
    (void)region_view(Aligned(bytes).bytes(), key, "forged");
  } catch (const maps::InputError& error) {
    return error.what();
  }
  return {};
}

TEST_F(IndexFile, TilesThatPointOutsideAreRefusedEvenWithTheRightChecksum) {
  const IndexKey wanted = key();
  const auto reason = [&](const std::function<void(CellBlocks::Tile&)>& change) {
    Forged forged(bytes_of(region_file()));
    maps::Section& section = forged.sections[0];
    std::vector<CellBlocks::Tile> tiles(section.bytes / sizeof(CellBlocks::Tile));
    std::memcpy(tiles.data(), forged.bytes.data() + section.offset, section.bytes);
    for (CellBlocks::Tile& tile : tiles) change(tile);
    section.crc = maps::crc32c(std::as_bytes(std::span(tiles)));
    std::memcpy(forged.bytes.data() + section.offset, tiles.data(), section.bytes);
    return refusal_of(forged.sealed(), wanted);
  };
  EXPECT_THAT(reason([](CellBlocks::Tile&) {}), IsEmpty());
  EXPECT_THAT(reason([](CellBlocks::Tile& tile) { tile.first_slot += 1; }),
              HasSubstr("tiles that lie outside"));
  EXPECT_THAT(reason([](CellBlocks::Tile& tile) { tile.x = 60'000; }), HasSubstr("out of order"));
}

TEST_F(IndexFile, BoundsThatNoMapHasAreRefusedEvenWithTheRightChecksum) {
  (void)open();
  const std::string good = bytes_of(file());
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double max_m : {kNaN, -1e7, 1e10}) {
      Forged forged(good);
      forged.about.max_m[axis] = max_m;
      put(file(), forged.sealed());
      EXPECT_THAT(open()->rebuilt_because(), HasSubstr("bounds that no map has")) << max_m;
    }
    Forged forged(good);
    forged.about.min_m[axis] = kNaN;
    put(file(), forged.sealed());
    EXPECT_THAT(open()->rebuilt_because(), HasSubstr("bounds that no map has"));
  }
}

TEST(IndexRoot, APlaceWithoutAViewIsRefused) {
  const IndexKey key{"", {}};
  RootContent root;
  root.bounds = Eigen::AlignedBox3d(Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones());
  root.regions.push_back({});
  root.places.resize(2);
  root.views.resize(2);
  root.views[1].sectors[39] = 5;
  const std::vector<CacheLine> whole = sections_of(key, root).lines();
  EXPECT_EQ(root_view(std::as_bytes(std::span(whole)), key, "root").views[1].sectors[39], 5U);
  root.views.pop_back();
  const std::vector<CacheLine> broken = sections_of(key, root).lines();
  try {
    (void)root_view(std::as_bytes(std::span(broken)), key, "root");
    ADD_FAILURE();
  } catch (const maps::InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("found 2 places with 1 views, expected a view of each"));
  }
}

TEST_F(IndexFile, SectionsThatAreMissingOrLieOutsideAreRefusedEvenWithTheRightChecksum) {
  const IndexKey wanted = key();
  const std::string good = bytes_of(region_file());
  const auto reason = [&](const std::function<void(Forged&)>& change) {
    Forged forged(good);
    change(forged);
    return refusal_of(forged.sealed(), wanted);
  };
  EXPECT_THAT(reason([](Forged& f) { f.header.sections = 0; }), HasSubstr("no tiles of level 0"));
  EXPECT_THAT(reason([](Forged& f) { f.sections.back().part = 9; }), HasSubstr("of level 2"));
  EXPECT_THAT(reason([](Forged& f) { f.sections.back().offset += 8; }), HasSubstr("aligned"));
  EXPECT_THAT(reason([](Forged& f) { f.sections.back().offset = ~std::uint64_t{63}; }),
              HasSubstr("inside the file"));
  EXPECT_THAT(reason([](Forged& f) { f.sections.back().bytes += 64; }),
              HasSubstr("inside the file"));
  EXPECT_THAT(reason([](Forged& f) { f.sections.back().item_bytes = 32; }),
              HasSubstr("voxels of 32 bytes"));
}

TEST_F(IndexFile, ManyOpenersAtOnceGetTheSameIndex) {
  std::vector<std::shared_ptr<const MapIndex>> opened(6);
  {
    std::vector<std::jthread> threads;
    for (auto& index : opened) threads.emplace_back([&] { index = open(); });
  }
  for (const auto& index : opened) expect_same(*opened.front(), *index);
  EXPECT_THAT(open()->rebuilt_because(), IsEmpty());
  EXPECT_EQ(std::distance(fs::directory_iterator(file().parent_path()), {}), 2);
}

TEST_F(IndexFile, IsNotMadeFromATileThatTheDiskHasChanged) {
  const fs::path tile = map_->folder() / "tiles/0_0_0.bin";
  const std::string sound = bytes_of(tile);
  std::string bytes = sound;
  bytes[40] = static_cast<char>(bytes[40] ^ 1);
  put(tile, bytes);
  EXPECT_THAT([&] { (void)MapIndex::open(*maps::MapPackage::open(map_->folder())); },
              ::testing::ThrowsMessage<maps::InputError>(HasSubstr("0_0_0.bin: found SHA-256")));
  EXPECT_FALSE(fs::exists(file()));
  put(tile, sound);
  EXPECT_THAT(open()->kept_in_memory_because(), IsEmpty());
}

TEST_F(IndexFile, IsNotMadeFromPointsThatAreNotFinite) {
  const fs::path tiles = map_->folder() / "tiles";
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(tiles)) {
    if (!entry.is_regular_file()) continue;
    std::string bytes = bytes_of(entry.path());
    const float infinite = std::numeric_limits<float>::infinity();
    std::memcpy(bytes.data() + offsetof(maps::MapPoint, y), &infinite, sizeof(infinite));
    put(entry.path(), bytes);
  }
  const auto broken = maps::MapPackage::open(map_->folder());
  EXPECT_THROW((void)MapIndex::open(*broken), maps::InputError);
  EXPECT_THROW((void)MapIndex::build(*broken), maps::InputError);
  EXPECT_THROW((void)MapPoints::build(*broken, 0.5), maps::InputError);
  EXPECT_FALSE(fs::exists(file()));
}

TEST_F(IndexFile, StaysUsableWhenItIsReplacedMeanwhile) {
  const auto mapped = open();
  const auto built = MapIndex::build(*map_);
  (void)test::window_of(*mapped);
  fs::remove(file());
  fs::remove(region_file());
  (void)open();
  expect_same(*mapped, *built);
}

TEST_F(IndexFile, WhatAKilledWriterLeftIsTakenUp) {
  const std::string good = bytes_of(open()->file());
  fs::remove(file());
  put(file().parent_path() / ("." + file().filename().string() + ".partial"), good + "and more");
  EXPECT_EQ(open()->file(), file());
  EXPECT_EQ(bytes_of(file()), good);
  EXPECT_EQ(std::distance(fs::directory_iterator(file().parent_path()), {}), 2);
}

TEST_F(IndexFile, WhereNoneCanBeWrittenItIsKeptInMemory) {
  // A file where the folder should be stops a writer of any user, root too.
  put(map_->folder() / "index", "");
  const auto index = open();
  EXPECT_THAT(index->file().string(), IsEmpty());
  EXPECT_THAT(index->kept_in_memory_because(), HasSubstr((map_->folder() / "index").string()));
  expect_same(*index, *MapIndex::build(*map_));
  index->verify();
}

/// Files may grow no further, and fail as on a full disk.
class FileLimit {
 public:
  explicit FileLimit(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    EXPECT_EQ(getrlimit(RLIMIT_FSIZE, &before_), 0);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    EXPECT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  }
  ~FileLimit() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  FileLimit(const FileLimit&) = delete;
  FileLimit& operator=(const FileLimit&) = delete;

 private:
  void (*handler_)(int);
  rlimit before_{};
};

TEST_F(IndexFile, IsWrittenWhereScratchFilesCannotBe) {
  (void)open();
  const std::string good = bytes_of(region_file());
  fs::remove_all(map_->folder() / "index");
  // The first piece of a scratch file is larger.
  const FileLimit limit(good.size());
  ASSERT_LT(good.size(), std::size_t{1} << 22);
  EXPECT_THAT(open()->kept_in_memory_because(), IsEmpty());
  EXPECT_EQ(bytes_of(region_file()), good);
}

TEST_F(IndexFile, OnAFullDiskItIsKeptInMemoryAndNothingIsLeft) {
  (void)open();
  const std::uint64_t bytes = fs::file_size(region_file());
  fs::remove_all(map_->folder() / "index");
  std::shared_ptr<const MapIndex> index;
  {
    const FileLimit limit(bytes - 1);
    index = open();
  }
  EXPECT_THAT(index->kept_in_memory_because(), HasSubstr("too large"));
  EXPECT_TRUE(fs::is_empty(map_->folder() / "index"));
  expect_same(*index, *MapIndex::build(*map_));
  EXPECT_EQ(open()->file(), file());
}

TEST_F(IndexFile, WhileAnotherWritesARegionItIsKeptInMemory) {
  {
    const maps::DerivedFile other(region_file());
    const auto index = open();
    EXPECT_THAT(index->kept_in_memory_because(), HasSubstr("being written by another process"));
    expect_same(*index, *MapIndex::build(*map_));
  }
  EXPECT_TRUE(fs::is_empty(map_->folder() / "index"));
}

/// Streets of a region along both axes, over all of its blocks.
std::vector<maps::MapPoint> crossing_streets() {
  std::vector<maps::MapPoint> points;
  for (const float at : {30.0F, 165.0F, 300.0F, 620.0F}) {
    for (const maps::MapPoint& p : street(639.0)) {
      points.push_back(p);
      points.back().y += at;
      points.push_back(p);
      std::swap(points.back().x, points.back().y);
      points.back().x += at;
    }
  }
  return points;
}

TEST(IndexRegion, InItsFileOrInMemoryTheBytesAreTheSameAndEachVoxelIsInItsCell) {
  const test::TemporaryFolder folder;
  const auto map = maps::MapPackage::open(write_map(folder.path() / "map", crossing_streets()));
  // Five of the coarsest cells in a block of 160 m, so that groups of four lie in two blocks.
  const MapIndexOptions options{.finest_voxel_m = 1.0, .levels = 6};
  const auto index = MapIndex::open(*map, options);
  EXPECT_THAT(index->kept_in_memory_because(), IsEmpty());
  const MapRegions regions(*map, options);
  const RegionContent content = regions.build({}, {});
  const IndexKey key{regions.source_of({}), options};
  const std::vector<CacheLine> lines = sections_of(key, content).lines();
  const auto bytes = std::as_bytes(std::span(lines));
  const std::string file = bytes_of(region_file_of(map->folder(), options, {}));
  ASSERT_EQ(file.size(), bytes.size());
  EXPECT_EQ(std::memcmp(file.data(), bytes.data(), bytes.size()), 0);
  index->verify();
  std::size_t voxels = 0;
  for (const MapIndex::Level& level : test::window_of(*index)->levels()) {
    for (const test::FoundVoxel& found : test::voxels_of(level)) {
      ++voxels;
      // A mean on the border may be rounded across it.
      const Eigen::Array3f beyond = found.mean.array() / level.edge_m - found.cell.cast<float>();
      ASSERT_TRUE((beyond > -1e-3F).all() && (beyond < 1.0F + 1e-3F).all()) << beyond;
    }
  }
  EXPECT_EQ(voxels, index->voxel_count());
  EXPECT_GT(voxels, 100'000U);
}

TEST_F(IndexFile, HoldsTheBytesOfItsFormatNumber) {
  // When this fails, files that users have would be read as something else: count kFormat up.
  EXPECT_EQ(index_format::kFormat, 3U);
  (void)open();
  // All but the header, which holds a digest.
  const auto sections_of = [](const fs::path& from) {
    const std::string bytes = bytes_of(from);
    return maps::crc32c(
        std::as_bytes(std::span<const char>(bytes).subspan(sizeof(maps::SectionHeader))));
  };
  EXPECT_EQ(sections_of(region_file()), 3373597133U);
  EXPECT_EQ(sections_of(file()), 323479076U);
}

/// Resident bytes of this process's mappings of a file.
std::size_t resident_bytes(const fs::path& file) {
  std::ifstream smaps("/proc/self/smaps");
  std::size_t kib = 0;
  bool inside = false;
  for (std::string line; std::getline(smaps, line);) {
    if (line.find('-') < line.find(' ')) inside = line.ends_with(file.string());
    if (inside && line.starts_with("Rss:")) kib += std::stoul(line.substr(4));
  }
  return kib * 1024;
}

/// Takes a file out of the system's cache; pages of it would otherwise count that nobody asked for.
void forget(const fs::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY);
  ASSERT_GE(descriptor, 0);
  EXPECT_EQ(::posix_fadvise(descriptor, 0, 0, POSIX_FADV_DONTNEED), 0);
  ::close(descriptor);
}

TEST(IndexPages, OnlyThoseNearTheQueriesAreRead) {
  const test::TemporaryFolder folder;
  const auto map = maps::MapPackage::open(write_map(folder.path() / "map", street(600.0)));
  (void)MapIndex::open(*map);
  const fs::path file = region_file_of(map->folder(), {}, {});
  forget(file);
  const auto size = static_cast<double>(fs::file_size(file));
  const auto index = MapIndex::open(*map);
  EXPECT_EQ(resident_bytes(file), 0U);
  const auto window = test::window_of(*index);
  const auto at_first = static_cast<double>(resident_bytes(file));
  std::size_t hits = 0;
  test::Random random(3);
  for (int k = 0; k < 20'000; ++k) {
    const Eigen::Vector3f p = some_point(random, 40.0);
    for (const MapIndex::Level& level : window->levels()) {
      hits += level.nearest(p, 0.01F).voxel != nullptr ? 1 : 0;
    }
  }
  EXPECT_GT(hits, 10'000U);
  const auto after = static_cast<double>(resident_bytes(file));
  if (at_first > 0.5 * size) GTEST_SKIP() << "the file system keeps whole files in memory";
  EXPECT_LT(at_first, 0.1 * size);
  EXPECT_GT(after, at_first);
  // A part in 15 of the street, and what the system reads around each of the six sections.
  EXPECT_LT(after, 0.3 * size);
}

}  // namespace index_file_test
}  // namespace stillmap::localization
