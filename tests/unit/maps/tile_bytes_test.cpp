#include "package/tile_bytes.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <random>

#include "support/throws.hpp"

namespace stillmap::maps {
namespace tile_bytes_test {

using test::ThrowsSaying;

/// Points of all kinds, one of them above the range of 16 bits and one below the base.
TileContent some_tile(std::size_t points, std::uint32_t scans = 40) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> along(0.0F, 20.0F), height(0.0F, 25.0F);
  std::uniform_int_distribution<int> byte(0, 255), turn(-127, 127);
  TileContent tile;
  tile.z_base_m = -3;
  for (std::size_t i = 0; i < points; ++i) {
    const auto number = static_cast<std::uint32_t>(i);
    if (i % 5 == 0) tile.of_objects.push_back({number, {number % 2, 300 + number / 10}});
    tile.points.push_back({along(random), along(random), height(random),
                           static_cast<float>(byte(random)), static_cast<std::uint16_t>(3 * i),
                           static_cast<PointKind>(i % 4), 0});
    const Eigen::Vector3f n =
        Eigen::Vector3f(static_cast<float>(turn(random)), static_cast<float>(turn(random)),
                        static_cast<float>(turn(random)) + 0.5F)
            .normalized();
    TilePointHistory history;
    history.first = {static_cast<std::uint32_t>(i % 3), static_cast<std::uint32_t>(i) % scans};
    history.last = {static_cast<std::uint32_t>(i % 3), static_cast<std::uint32_t>(2 * i) % scans};
    for (std::size_t axis = 0; axis < 3; ++axis)
      history.normal[axis] =
          static_cast<std::int8_t>(std::lround(127.0F * n[static_cast<Eigen::Index>(axis)]));
    history.planarity = static_cast<std::uint8_t>(byte(random));
    tile.history.push_back(history);
  }
  tile.evidence.base_m = -2;
  tile.evidence.drives = {{1, {}, {}}, {4, {}, {}}};
  for (std::size_t cube = 0; cube < TileEvidence::kCubes; cube += 3)
    tile.evidence.drives[0].free.set(cube);
  tile.evidence.drives[1].hit.set(3199);
  tile.points[1].z = 120.0F;
  tile.points[2].z = -0.7F;
  tile.history[3].normal = {};
  return tile;
}

TEST(TileSteps, AreExactAndTheMiddleOfTheirs) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> along(0.0, 20.0), height(-100.0, 1000.0);
  for (int i = 0; i < 100'000; ++i) {
    const double x = along(random), z = height(random);
    EXPECT_LE(std::abs(in_tile_steps(x) - x), kTileStepM / 2 + 1e-12);
    EXPECT_LE(std::abs(in_height_steps(z) - z), kTileStepZM / 2 + 1e-12);
    EXPECT_EQ(in_tile_steps(in_tile_steps(x)), in_tile_steps(x));
    EXPECT_EQ(in_height_steps(in_height_steps(z)), in_height_steps(z));
  }
  EXPECT_LT(std::hypot(kTileStepM / 2, kTileStepM / 2, kTileStepZM / 2), 0.0005);
  // By a rounding beside the tile.
  EXPECT_EQ(in_tile_steps(-1e-6), in_tile_steps(0.0));
  EXPECT_EQ(in_tile_steps(20.0), in_tile_steps(19.9999));
  EXPECT_LT(in_tile_steps(20.0), 20.0F);
}

TEST(TileBytes, HoldWhatIsInStepsToTheBit) {
  TileContent tile = some_tile(1000);
  const TileContent once = decode_tile(encode_tile(tile), "tile");
  EXPECT_EQ(once.z_base_m, tile.z_base_m);
  ASSERT_EQ(once.points.size(), tile.points.size());
  ASSERT_EQ(once.history.size(), tile.points.size());
  for (std::size_t i = 0; i < tile.points.size(); ++i) {
    EXPECT_EQ(once.points[i].x, in_tile_steps(tile.points[i].x));
    EXPECT_EQ(once.points[i].y, in_tile_steps(tile.points[i].y));
    EXPECT_EQ(once.points[i].z, in_height_steps(tile.points[i].z));
    EXPECT_EQ(once.points[i].intensity, tile.points[i].intensity);
    EXPECT_EQ(once.points[i].observations, tile.points[i].observations);
    EXPECT_EQ(once.points[i].kind, tile.points[i].kind);
    EXPECT_EQ(once.history[i].first, tile.history[i].first);
    EXPECT_EQ(once.history[i].last, tile.history[i].last);
    EXPECT_EQ(once.history[i].normal, tile.history[i].normal);
    EXPECT_EQ(once.history[i].planarity, tile.history[i].planarity);
  }
  ASSERT_EQ(once.of_objects.size(), 200U);
  for (std::size_t i = 0; i < 200; ++i) {
    EXPECT_EQ(once.of_objects[i].point, tile.of_objects[i].point);
    EXPECT_EQ(once.of_objects[i].object, tile.of_objects[i].object);
  }
  EXPECT_EQ(once.evidence.base_m, -2);
  ASSERT_EQ(once.evidence.drives.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(once.evidence.drives[i].drive, tile.evidence.drives[i].drive);
    EXPECT_EQ(once.evidence.drives[i].free, tile.evidence.drives[i].free);
    EXPECT_EQ(once.evidence.drives[i].hit, tile.evidence.drives[i].hit);
  }
  EXPECT_EQ(encode_tile(once), encode_tile(tile));
}

TEST(TileBytes, TakeAtMostTwentyAPoint) {
  const std::size_t points = 20'000;
  TileContent tile = some_tile(points);
  std::erase_if(tile.of_objects, [](const auto& each) { return each.point % 50 != 0; });
  tile.evidence = {};
  EXPECT_LT(static_cast<double>(encode_tile(tile).size()) / points, 20.0);
}

TEST(TileBytes, NumberMoreScansThanSixteenBitsDo) {
  TileContent tile = some_tile(70'000, 1'000'000);
  for (std::size_t i = 0; i < tile.history.size(); ++i)
    tile.history[i].first = {9, static_cast<std::uint32_t>(i)};
  const TileContent read = decode_tile(encode_tile(tile), "tile");
  for (std::size_t i = 0; i < tile.history.size(); ++i) {
    ASSERT_EQ(read.history[i].first, tile.history[i].first);
    ASSERT_EQ(read.history[i].last, tile.history[i].last);
  }
}

TEST(TileBytes, NumberMoreObjectsThanSixteenBitsDo) {
  TileContent tile = some_tile(70'000);
  tile.of_objects.clear();
  for (std::uint32_t i = 0; i < 70'000; ++i) tile.of_objects.push_back({i, {3, 2 * i}});
  const TileContent read = decode_tile(encode_tile(tile), "tile");
  ASSERT_EQ(read.of_objects.size(), 70'000U);
  for (std::size_t i = 0; i < 70'000; ++i)
    ASSERT_EQ(read.of_objects[i].object, tile.of_objects[i].object);
}

TEST(TileBytes, MayHaveNoHistory) {
  TileContent tile = some_tile(100);
  tile.history.clear();
  const TileContent read = decode_tile(encode_tile(tile), "tile");
  EXPECT_TRUE(read.history.empty());
  EXPECT_EQ(read.of_objects.at(1).object, tile.of_objects[1].object);
  const TileContent without = decode_tile(encode_tile(some_tile(100)), "tile", false);
  EXPECT_TRUE(without.history.empty());
  EXPECT_EQ(without.points.size(), 100U);
}

TEST(TileBytes, KeepIntensitiesToElevenBits) {
  TileContent tile = some_tile(4);
  const std::array<float, 4> values{0.1234F, 65535.0F, -1e30F, 255.0F};
  for (std::size_t i = 0; i < 4; ++i) tile.points[i].intensity = values[i];
  const TileContent read = decode_tile(encode_tile(tile), "tile");
  EXPECT_NEAR(read.points[0].intensity, 0.1234, 0.1234 / 2048);
  EXPECT_EQ(read.points[1].intensity, 65504.0F);
  EXPECT_EQ(read.points[2].intensity, -65504.0F);
  EXPECT_EQ(read.points[3].intensity, 255.0F);
}

TEST(TileBytes, AreThoseOfThePage) {
  const std::vector<std::byte> bytes = encode_tile(some_tile(10));
  EXPECT_EQ(bytes.size(), 2072U);
  EXPECT_EQ(crc32c(bytes), 3640530487U);
}

TEST(TileBytes, RefuseWhatIsNoTile) {
  const std::vector<std::byte> whole = encode_tile(some_tile(50));
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_THROW((void)decode_tile(std::span(whole).first(size), "tile"), InputError) << size;
  std::vector<std::byte> longer = whole;
  longer.resize(whole.size() + 8);
  EXPECT_THAT([&] { (void)decode_tile(longer, "tile 1 2"); },
              (ThrowsSaying<InputError>({"tile 1 2", "bytes for 50 points", "again"})));
}

TEST(TileBytes, TrustNothing) {
  const std::vector<std::byte> whole = encode_tile(some_tile(50));
  std::mt19937 random(3);
  int refused = 0;
  for (int i = 0; i < 20'000; ++i) {
    std::vector<std::byte> bytes = whole;
    for (int k = 0; k < 3; ++k) bytes[random() % bytes.size()] = static_cast<std::byte>(random());
    try {
      // Columns are filled up to 8 bytes: so many take no more of them than 50 do.
      EXPECT_LE(decode_tile(bytes, "tile").points.size(), 56U);
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 1000);
}

TEST(TileBytes, AreNotMadeOfWhatCannotBeATile) {
  const auto encode = [](const std::function<void(TileContent&)>& change) {
    TileContent tile = some_tile(5);
    change(tile);
    (void)encode_tile(tile);
  };
  EXPECT_THROW(encode([](TileContent& tile) { tile.points.clear(); }), std::invalid_argument);
  EXPECT_THROW(encode([](TileContent& tile) { tile.history.pop_back(); }), std::invalid_argument);
  EXPECT_THROW(encode([](TileContent& tile) {
                 tile.evidence.drives.push_back({4, {}, {}});
               }),
               std::invalid_argument);
  EXPECT_THROW(encode([](TileContent& tile) {
                 tile.of_objects = {{5, {}}};
               }),
               std::invalid_argument);
  EXPECT_THROW(encode([](TileContent& tile) {
                 tile.of_objects = {{2, {}}, {2, {}}};
               }),
               std::invalid_argument);
  EXPECT_THROW(encode([](TileContent& tile) { tile.points[0].z = NAN; }), std::invalid_argument);
  EXPECT_THROW(encode([](TileContent& tile) { tile.points[0].z = 1e9F; }), std::invalid_argument);
  EXPECT_THROW(encode([](TileContent& tile) { tile.points[0].kind = static_cast<PointKind>(4); }),
               std::invalid_argument);
}

}  // namespace tile_bytes_test
}  // namespace stillmap::maps
