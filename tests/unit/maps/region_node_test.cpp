#include "package/region_node.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/error.hpp>

#include <functional>
#include <random>

#include "support/throws.hpp"

namespace stillmap::maps {
namespace region_node_test {

using test::ThrowsSaying;

/// A region that owns what it holds.
struct OwnRegion {
  std::vector<Pack> packs;
  std::vector<RegionTile> tiles;

  [[nodiscard]] RegionNode node() const { return {packs, tiles}; }
};

OwnRegion some_region() {
  OwnRegion region;
  for (std::uint8_t i = 0; i < 2; ++i) {
    Pack pack{.bytes = 1000};
    pack.sha256.fill(std::byte{i});
    region.packs.push_back(pack);
  }
  for (std::uint8_t i = 0; i < 5; ++i) {
    RegionTile tile{.x = i, .y = static_cast<std::uint8_t>(31 - i), .pack = 1};
    tile.points = 10U + i;
    tile.offset = 100U * i;
    tile.bytes = 96;
    tile.z_base_m = -4;
    tile.min_xy = {5, 6};
    tile.max_xy = {65535, 700};
    tile.min_z = -3;
    tile.max_z = 70'000;
    tile.sha256.fill(std::byte{7});
    region.tiles.push_back(tile);
  }
  return region;
}

TEST(RegionNode, ComesBackAsItWas) {
  const std::vector<std::byte> bytes = encode_region(some_region().node());
  EXPECT_EQ(bytes.size(), 16U + 2 * 40 + 5 * 72);
  const RegionNode read = decode_region(bytes, "region");
  EXPECT_EQ(read.tiles.size(), 5U);
  EXPECT_EQ(read.tiles[4].x, 4);
  EXPECT_EQ(read.tiles[4].max_z, 70'000);
  EXPECT_EQ(encode_region(read), bytes);
}

TEST(RegionNode, HasTheBytesOfThePage) {
  EXPECT_EQ(crc32c(encode_region(some_region().node())), 257614795U);
}

TEST(RegionNode, RefusesWhatCannotBe) {
  const auto refused = [](const std::function<void(OwnRegion&)>& change) {
    OwnRegion region = some_region();
    change(region);
    EXPECT_THROW((void)encode_region(region.node()), std::invalid_argument);
  };
  refused([](OwnRegion& region) { region.tiles[0].x = 32; });
  refused([](OwnRegion& region) { std::swap(region.tiles[0], region.tiles[1]); });
  refused([](OwnRegion& region) { region.tiles[1] = region.tiles[0]; });
  refused([](OwnRegion& region) { region.tiles[2].points = 0; });
  refused([](OwnRegion& region) { region.tiles[2].pack = 2; });
  refused([](OwnRegion& region) { region.tiles[2].offset = 905; });
  refused([](OwnRegion& region) { region.tiles[2].offset = ~std::uint64_t{0}; });
}

TEST(RegionNode, TrustsNothing) {
  const std::vector<std::byte> whole = encode_region(some_region().node());
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_THROW((void)decode_region(std::span(whole).first(size), "region"), InputError);
  std::mt19937 random(5);
  for (int i = 0; i < 20'000; ++i) {
    std::vector<std::byte> bytes = whole;
    for (int k = 0; k < 3; ++k) bytes[random() % bytes.size()] = static_cast<std::byte>(random());
    try {
      const RegionNode read = decode_region(bytes, "region");
      for (const RegionTile& tile : read.tiles)
        EXPECT_LE(tile.offset + tile.bytes, read.packs[tile.pack].bytes);
    } catch (const InputError&) {
    }
  }
  EXPECT_THAT([] { (void)decode_region(std::vector<std::byte>(16), "0_0.node"); },
              (ThrowsSaying<InputError>({"0_0.node", "beginning", "again"})));
}

}  // namespace region_node_test
}  // namespace stillmap::maps
