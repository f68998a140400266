#include "package/region_node.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <cstring>
#include <optional>
#include <stdexcept>
#include <utility>

namespace stillmap::maps {
namespace {

constexpr std::array<char, 8> kRegionMagic{'s', 'm', 'r', 'e', 'g', 'i', 'o', '1'};

struct RegionHead {
  std::array<char, 8> magic = kRegionMagic;
  std::uint32_t packs = 0;
  std::uint32_t tiles = 0;
};
static_assert(sizeof(RegionHead) == 16 && sizeof(Pack) == 40);

std::uint64_t size_of(const RegionHead& head) {
  return sizeof(head) + std::uint64_t{head.packs} * sizeof(Pack) +
         std::uint64_t{head.tiles} * sizeof(RegionTile);
}

/// What is wrong with a region: what was found, and what was expected.
std::optional<std::pair<std::string, std::string>> fault_of(const RegionNode& region) {
  int before = -1;
  for (const RegionTile& tile : region.tiles) {
    const std::string name = fmt::format("tile {}, {}", tile.x, tile.y);
    if (tile.x >= kRegionTiles || tile.y >= kRegionTiles)
      return std::pair(name, fmt::format("numbers below {}", kRegionTiles));
    const int place = kRegionTiles * tile.x + tile.y;
    if (place <= before) return std::pair(name + " out of its order", "tiles by x, then y");
    before = place;
    if (tile.points == 0) return std::pair(name + " without points", "at least one");
    if (tile.pack >= region.packs.size())
      return std::pair(fmt::format("{} in pack {}", name, tile.pack),
                       fmt::format("one of {} packs", region.packs.size()));
    const std::uint64_t end = region.packs[tile.pack].bytes;
    if (tile.offset > end || tile.bytes > end - tile.offset)
      return std::pair(fmt::format("{}: {} bytes at {}", name, tile.bytes, tile.offset),
                       fmt::format("within the pack's {}", end));
  }
  return std::nullopt;
}

}  // namespace

std::vector<std::byte> encode_region(const RegionNode& region) {
  if (const auto fault = fault_of(region))
    throw std::invalid_argument("a region: found " + fault->first + ", expected " + fault->second);
  const RegionHead head{.packs = static_cast<std::uint32_t>(region.packs.size()),
                        .tiles = static_cast<std::uint32_t>(region.tiles.size())};
  std::vector<std::byte> bytes(size_of(head));
  std::memcpy(bytes.data(), &head, sizeof(head));
  std::byte* const packs = bytes.data() + sizeof(head);
  if (head.packs > 0) std::memcpy(packs, region.packs.data(), head.packs * sizeof(Pack));
  if (head.tiles > 0)
    std::memcpy(packs + head.packs * sizeof(Pack), region.tiles.data(),
                head.tiles * sizeof(RegionTile));
  return bytes;
}

RegionNode decode_region(std::span<const std::byte> bytes, const std::string& name) {
  const std::string remedy = ": copy or build the map again";
  RegionHead head;
  if (bytes.size() < sizeof(head))
    throw InputError(name, fmt::format("{} bytes", bytes.size()), "a region's head" + remedy);
  std::memcpy(&head, bytes.data(), sizeof(head));
  if (head.magic != kRegionMagic)
    throw InputError(name, "other bytes at its beginning", "smregio1" + remedy);
  const std::uint64_t expected = size_of(head);
  if (bytes.size() != expected)
    throw InputError(
        name, fmt::format("{} bytes", bytes.size()),
        fmt::format("{} for {} packs and {} tiles", expected, head.packs, head.tiles) + remedy);
  const std::byte* const packs = bytes.data() + sizeof(head);
  const std::byte* const tiles = packs + head.packs * sizeof(Pack);
  const RegionNode region{{reinterpret_cast<const Pack*>(packs), head.packs},
                          {reinterpret_cast<const RegionTile*>(tiles), head.tiles}};
  if (const auto fault = fault_of(region))
    throw InputError(name, fault->first, fault->second + remedy);
  return region;
}

}  // namespace stillmap::maps
