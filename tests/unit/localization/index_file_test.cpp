#include "index/index_file.hpp"
#include "index/index_format.hpp"
#include "index/map_level.hpp"
#include "reference/map_points.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>
#include <support/temporary_folder.hpp>

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cmath>
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

void expect_same_grids(const MapIndex& a, const MapIndex& b) {
  ASSERT_EQ(a.place_grids().size(), kPlaceGrids.size());
  ASSERT_EQ(b.place_grids().size(), kPlaceGrids.size());
  for (std::size_t k = 0; k < kPlaceGrids.size(); ++k) {
    EXPECT_EQ(a.place_grids()[k].edge_m(), b.place_grids()[k].edge_m());
    test::Random random(k);
    unsigned hits = 0;
    for (int n = 0; n < 2000; ++n) {
      const Eigen::Vector3f p(static_cast<float>(random.uniform(-2.0, 32.0)),
                              static_cast<float>(random.uniform(-2.0, 12.0)),
                              static_cast<float>(random.uniform(-2.0, 6.0)));
      ASSERT_EQ(hit(a.place_grids()[k], p), hit(b.place_grids()[k], p));
      hits += hit(a.place_grids()[k], p);
    }
    EXPECT_GT(hits, 200U);
  }
}

void expect_same(const MapIndex& a, const MapIndex& b) {
  expect_same_grids(a, b);
  EXPECT_EQ(a.origin(), b.origin());
  EXPECT_EQ(a.extent(), b.extent());
  ASSERT_EQ(a.levels().size(), b.levels().size());
  for (std::size_t k = 0; k < a.levels().size(); ++k) {
    const MapIndex::Level& one = a.levels()[k];
    const MapIndex::Level& other = b.levels()[k];
    EXPECT_EQ(one.edge_m, other.edge_m);
    ASSERT_EQ(one.voxels.size(), other.voxels.size());
    EXPECT_EQ(
        std::memcmp(one.voxels.data(), other.voxels.data(), one.voxels.size() * sizeof(Voxel)), 0);
    test::Random random(k);
    for (int n = 0; n < 2000; ++n) {
      const Eigen::Vector3f p(static_cast<float>(random.uniform(-2.0, 32.0)),
                              static_cast<float>(random.uniform(-2.0, 12.0)),
                              static_cast<float>(random.uniform(-2.0, 6.0)));
      const MapIndex::Level::Nearest x = one.nearest(p, 0.01F);
      const MapIndex::Level::Nearest y = other.nearest(p, 0.01F);
      ASSERT_EQ(x.voxel == nullptr, y.voxel == nullptr);
      if (x.voxel == nullptr) continue;
      ASSERT_EQ(x.voxel - one.voxels.data(), y.voxel - other.voxels.data());
      ASSERT_EQ(x.distance2, y.distance2);
    }
  }
}

class IndexFile : public ::testing::Test {
 protected:
  [[nodiscard]] std::shared_ptr<const MapIndex> open() const { return MapIndex::open(*map_); }
  [[nodiscard]] fs::path file() const { return index_file_of(map_->folder(), {}); }

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
  EXPECT_EQ(MapIndex::open(*map_, coarse)->levels().back().edge_m, 1.0F);
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
      {with(8, 2), "found format 2, expected format 1"},
      {with(100, 'x'), "checksum"},
      {bytes_of(MapIndex::open(*other_map)->file()), "an index of map"},
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

/// Where the directories end: all that is read at load.
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

TEST_F(IndexFile, NoBitOfWhatIsReadAtLoadFlipsUnseen) {
  const std::string good = bytes_of(open()->file());
  const std::size_t end = bytes_read_at_load(good);
  ASSERT_GT(end, sizeof(maps::SectionHeader));
  std::vector<CacheLine> lines(good.size() / sizeof(CacheLine));
  const std::span<std::byte> bytes = std::as_writable_bytes(std::span(lines));
  std::memcpy(bytes.data(), good.data(), good.size());
  const IndexKey key{map_->digest(), {}};
  (void)view_of(bytes, key, "x");
  std::size_t unseen = 0;
  for (std::size_t at = 0; at < end; ++at) {
    bytes[at] ^= std::byte{1} << (at % 8);
    try {
      (void)view_of(bytes, key, "x");
      ++unseen;
    } catch (const maps::InputError&) {
    }
    bytes[at] ^= std::byte{1} << (at % 8);
  }
  // Only the zeros between two sections.
  EXPECT_LT(unseen, 7 * index_format::kAlignment);
}

TEST_F(IndexFile, DamageBehindTheHeaderIsFoundByVerifyAndReachesNothingOutside) {
  const std::string good = bytes_of(open()->file());
  test::Random random(5);
  for (int round = 0; round < 30; ++round) {
    std::string damaged = good;
    for (int k = 0; k < 200; ++k) {
      const auto at = static_cast<std::size_t>(random.uniform(
          static_cast<double>(bytes_read_at_load(good)), static_cast<double>(good.size())));
      damaged[at] = static_cast<char>(random.uniform(-128.0, 128.0));
    }
    put(file(), damaged);
    const auto index = open();
    EXPECT_THAT(index->rebuilt_because(), IsEmpty());
    EXPECT_THROW(index->verify(), maps::InputError);
    for (const CellBits& grid : index->place_grids()) {
      for (float x = -2.0F; x < 40.0F; x += 0.5F) (void)hit(grid, {x, 0.3F * x, 1.0F});
    }
    for (const MapIndex::Level& level : index->levels()) {
      for (int n = 0; n < 3000; ++n) {
        const Eigen::Vector3f p(static_cast<float>(random.uniform(-2.0, 32.0)),
                                static_cast<float>(random.uniform(-2.0, 12.0)),
                                static_cast<float>(random.uniform(-2.0, 6.0)));
        const Voxel* voxel = level.nearest(p, 0.01F).voxel;
        if (voxel == nullptr) continue;
        ASSERT_GE(voxel, level.voxels.data());
        ASSERT_LT(voxel, level.voxels.data() + level.voxels.size());
      }
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

TEST_F(IndexFile, TilesThatPointOutsideAreRefusedEvenWithTheRightChecksum) {
  Forged forged(bytes_of(open()->file()));
  maps::Section& section = forged.sections[0];
  std::vector<CellBlocks::Tile> tiles(section.bytes / sizeof(CellBlocks::Tile));
  std::memcpy(tiles.data(), forged.bytes.data() + section.offset, section.bytes);
  for (CellBlocks::Tile& tile : tiles) {
    if (tile.slots != 0) tile.first_slot += 1;
  }
  section.crc = maps::crc32c(std::as_bytes(std::span(tiles)));
  std::memcpy(forged.bytes.data() + section.offset, tiles.data(), section.bytes);
  put(file(), forged.sealed());
  EXPECT_THAT(open()->rebuilt_because(), HasSubstr("tiles that lie outside"));
}

TEST_F(IndexFile, BoundsThatNoMapHasAreRefusedEvenWithTheRightChecksum) {
  const std::string good = bytes_of(open()->file());
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double extent_m : {kNaN, -1.0, 1e7}) {
      Forged forged(good);
      forged.about.extent_m[axis] = extent_m;
      put(file(), forged.sealed());
      EXPECT_THAT(open()->rebuilt_because(), HasSubstr("bounds that no map has")) << extent_m;
    }
    Forged forged(good);
    forged.about.origin_m[axis] = kNaN;
    put(file(), forged.sealed());
    EXPECT_THAT(open()->rebuilt_because(), HasSubstr("bounds that no map has"));
  }
}

TEST_F(IndexFile, SectionsThatAreMissingOrLieOutsideAreRefusedEvenWithTheRightChecksum) {
  const std::string good = bytes_of(open()->file());
  const auto reason = [&](const std::function<void(Forged&)>& change) {
    Forged forged(good);
    change(forged);
    put(file(), forged.sealed());
    return open()->rebuilt_because();
  };
  EXPECT_THAT(reason([](Forged& f) { f.header.sections = 0; }), HasSubstr("no slots of level 0"));
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
  EXPECT_EQ(std::distance(fs::directory_iterator(file().parent_path()), {}), 1);
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
  fs::remove(file());
  (void)open();
  expect_same(*mapped, *built);
}

TEST_F(IndexFile, WhatAKilledWriterLeftIsTakenUp) {
  const std::string good = bytes_of(open()->file());
  fs::remove(file());
  put(file().parent_path() / ("." + file().filename().string() + ".partial"), good + "and more");
  EXPECT_EQ(open()->file(), file());
  EXPECT_EQ(bytes_of(file()), good);
  EXPECT_EQ(std::distance(fs::directory_iterator(file().parent_path()), {}), 1);
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

TEST_F(IndexFile, HoldsTheBytesOfItsFormatNumber) {
  // When this fails, files that users have would be read as something else: count kFormat up.
  EXPECT_EQ(index_format::kFormat, 1U);
  const std::string bytes = bytes_of(open()->file());
  // All but the header, which holds the digest.
  const std::span<const char> sections = std::span(bytes).subspan(sizeof(maps::SectionHeader));
  EXPECT_EQ(maps::crc32c(std::as_bytes(sections)), 2342770324U);
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
  const auto map = maps::MapPackage::open(write_map(folder.path() / "map", street(1000.0)));
  const fs::path file = MapIndex::open(*map)->file();
  forget(file);
  const auto size = static_cast<double>(fs::file_size(file));
  const auto index = MapIndex::open(*map);
  const auto at_load = static_cast<double>(resident_bytes(file));
  std::size_t hits = 0;
  test::Random random(3);
  for (int k = 0; k < 20'000; ++k) {
    const Eigen::Vector3f p(static_cast<float>(random.uniform(0.0, 40.0)),
                            static_cast<float>(random.uniform(0.0, 11.0)),
                            static_cast<float>(random.uniform(0.0, 4.0)));
    for (const MapIndex::Level& level : index->levels()) {
      hits += level.nearest(p, 0.01F).voxel != nullptr ? 1 : 0;
    }
  }
  EXPECT_GT(hits, 10'000U);
  const auto after = static_cast<double>(resident_bytes(file));
  if (at_load > 0.5 * size) GTEST_SKIP() << "the file system keeps whole files in memory";
  EXPECT_LT(at_load, 0.1 * size);
  EXPECT_GT(after, at_load);
  // A part in 25 of the street, and what the system reads around each of the six sections.
  EXPECT_LT(after, 0.3 * size);
}

}  // namespace index_file_test
}  // namespace stillmap::localization
