#include "index/index_bytes.hpp"

#include "index/index_format.hpp"

#include <stillmap/maps/crc32c.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>

namespace stillmap::localization {
namespace {

using index_format::About;
using index_format::Kind;
using maps::Section;
using maps::SectionPart;

const char* name_of(std::uint32_t kind) {
  switch (static_cast<Kind>(kind)) {
    case Kind::kTiles:
      return "tiles";
    case Kind::kSlots:
      return "slots";
    case Kind::kVoxels:
      return "voxels";
    case Kind::kGridTiles:
      return "grid tiles";
    case Kind::kGridWords:
      return "grid words";
  }
  return "unknown";
}

About about_of(const IndexKey& key) {
  About about;
  std::copy_n(key.map_digest.begin(), std::min(key.map_digest.size(), about.map_digest.size()),
              about.map_digest.begin());
  about.finest_voxel_m = key.options.finest_voxel_m;
  about.min_points = static_cast<std::uint32_t>(key.options.min_points);
  return about;
}

template <typename Item>
SectionPart part_of(Kind kind, std::size_t level, std::span<const Item> items) {
  return maps::section_part(static_cast<std::uint32_t>(kind), static_cast<std::uint32_t>(level),
                            std::as_bytes(items), sizeof(Item));
}

/// Directories first: they are read at load, so they had better share a page with the header.
std::vector<SectionPart> parts_of(const IndexContent& content) {
  std::vector<SectionPart> parts;
  for (std::size_t k = 0; k < content.levels.size(); ++k) {
    parts.push_back(part_of(Kind::kTiles, k, content.levels[k].cells.tiles()));
  }
  for (std::size_t k = 0; k < content.place_grids.size(); ++k) {
    parts.push_back(part_of(Kind::kGridTiles, k, content.place_grids[k].tiles()));
  }
  for (std::size_t k = 0; k < content.place_grids.size(); ++k) {
    parts.push_back(part_of(Kind::kGridWords, k, content.place_grids[k].words()));
  }
  for (std::size_t k = 0; k < content.levels.size(); ++k) {
    const VoxelLevel& level = content.levels[k];
    parts.push_back(part_of(Kind::kSlots, k, level.cells.slots()));
    parts.push_back(part_of(Kind::kVoxels, k, std::span<const Voxel>(level.voxels)));
  }
  return parts;
}

class Parser {
 public:
  Parser(std::span<const std::byte> bytes, const std::string& name)
      : bytes_(bytes),
        table_(bytes, bytes.size(), index_format::kIndex, name),
        about_(table_.header().read_about<About>()) {}

  [[nodiscard]] const About& about() const { return about_; }
  [[nodiscard]] std::uint32_t levels() const { return table_.header().count; }
  [[nodiscard]] const std::vector<Section>& sections() const { return table_.sections(); }
  [[noreturn]] void refuse(const std::string& found, const std::string& expected) const {
    table_.refuse(found, expected);
  }

  template <typename Item>
  [[nodiscard]] std::span<const Item> items(const Section& section) const {
    if (section.item_bytes != sizeof(Item) || section.bytes % sizeof(Item) != 0) {
      refuse(fmt::format("{} of {} bytes", name_of(section.kind), section.item_bytes),
             fmt::format("{}", sizeof(Item)));
    }
    return {reinterpret_cast<const Item*>(bytes_.data() + section.offset),
            section.bytes / sizeof(Item)};
  }
  [[nodiscard]] const Section& section(Kind kind, std::uint32_t level) const {
    const Section* section = table_.find(static_cast<std::uint32_t>(kind), level);
    if (section != nullptr) return *section;
    refuse(fmt::format("no {} of level {}", name_of(static_cast<std::uint32_t>(kind)), level),
           "all sections");
  }
  void verify(const Section& section) const {
    if (maps::crc32c(bytes_.subspan(section.offset, section.bytes)) != section.crc) {
      refuse(fmt::format("{} of level {} that do not fit their checksum", name_of(section.kind),
                         section.part),
             "undamaged ones");
    }
  }

 private:
  std::span<const std::byte> bytes_;
  maps::SectionTable table_;
  About about_;
};

void require_key(const Parser& parser, const IndexKey& key) {
  const About& found = parser.about();
  const About wanted = about_of(key);
  const auto wanted_levels = static_cast<std::uint32_t>(key.options.levels);
  if (found.map_digest != wanted.map_digest) {
    parser.refuse(fmt::format("an index of map {:.12}",
                              std::string(found.map_digest.begin(), found.map_digest.end())),
                  fmt::format("of map {:.12}", key.map_digest));
  }
  if (parser.levels() != wanted_levels || found.finest_voxel_m != wanted.finest_voxel_m ||
      found.min_points != wanted.min_points) {
    parser.refuse(
        fmt::format("{} levels, finest voxel {} m, at least {} points", parser.levels(),
                    found.finest_voxel_m, found.min_points),
        fmt::format("{}, {} m, {}", wanted_levels, wanted.finest_voxel_m, wanted.min_points));
  }
}

std::span<const CellBlocks::Tile> tiles_of(const Parser& parser, std::uint32_t level,
                                           std::size_t slots) {
  const Section& section = parser.section(Kind::kTiles, level);
  const std::span<const CellBlocks::Tile> tiles = parser.items<CellBlocks::Tile>(section);
  parser.verify(section);
  // The checksum is no proof against a file that was made on purpose.
  const bool good = tiles.size() >= 2 && std::has_single_bit(tiles.size()) &&
                    std::all_of(tiles.begin(), tiles.end(), [&](const CellBlocks::Tile& tile) {
                      return tile.slots == 0 ||
                             (tile.slots >= 2 && std::has_single_bit(tile.slots) &&
                              tile.shift == CellBlocks::shift_of(tile.slots) &&
                              tile.first_slot <= slots && tile.slots <= slots - tile.first_slot);
                    });
  if (!good) parser.refuse("tiles that lie outside their section", "such that lie inside");
  return tiles;
}

MapIndex::Level level_of(const Parser& parser, std::uint32_t level) {
  const auto slots = parser.items<CellBlocks::Slot>(parser.section(Kind::kSlots, level));
  const auto voxels = parser.items<Voxel>(parser.section(Kind::kVoxels, level));
  if (voxels.size() >= CellBlocks::kNone) parser.refuse("too many voxels", "fewer than 2^32 - 1");
  MapIndex::Level view;
  view.edge_m = static_cast<float>(
      std::ldexp(parser.about().finest_voxel_m,
                 static_cast<int>(parser.levels()) - 1 - static_cast<int>(level)));
  view.cells = CellBlocks(tiles_of(parser, level, slots.size()), slots,
                          static_cast<std::uint32_t>(voxels.size()));
  view.voxels = voxels;
  return view;
}

CellBits place_grid_of(const Parser& parser, std::uint32_t grid, const Eigen::Vector3d& extent) {
  const Section& section = parser.section(Kind::kGridTiles, grid);
  const auto tiles = parser.items<std::uint32_t>(section);
  const auto words = parser.items<std::uint64_t>(parser.section(Kind::kGridWords, grid));
  parser.verify(section);
  const TiledColumns columns(extent, kPlaceGrids[grid].edge_m);
  const bool good = tiles.size() == columns.tiles() &&
                    std::all_of(tiles.begin(), tiles.end(), [&](std::uint32_t first) {
                      return first + TiledColumns::kColumnsOfTile <= words.size();
                    });
  if (!good) parser.refuse("grid tiles that lie outside their section", "such that lie inside");
  return {kPlaceGrids[grid].edge_m, extent, tiles, words};
}

}  // namespace

std::vector<CacheLine> to_bytes(const IndexKey& key, const IndexContent& content) {
  About about = about_of(key);
  Eigen::Vector3d::Map(about.origin_m.data()) = content.origin;
  Eigen::Vector3d::Map(about.extent_m.data()) = content.extent;
  maps::SectionHeader header;
  header.count = static_cast<std::uint32_t>(key.options.levels);
  header.set_about(about);
  return maps::section_bytes(index_format::kIndex, header, parts_of(content)).lines;
}

IndexView view_of(std::span<const std::byte> bytes, const IndexKey& key, const std::string& name) {
  const Parser parser(bytes, name);
  require_key(parser, key);
  IndexView view;
  view.origin = Eigen::Vector3d::Map(parser.about().origin_m.data());
  view.extent = Eigen::Vector3d::Map(parser.about().extent_m.data());
  const double limit_m = key.options.finest_voxel_m * kCellsPerAxis;
  // NaN on its own: minCoeff() and maxCoeff() may pass it over.
  if (!(view.origin.allFinite() && view.extent.allFinite() && view.extent.minCoeff() >= 0.0 &&
        view.extent.maxCoeff() < limit_m)) {
    parser.refuse("bounds that no map has", fmt::format("an extent below {} m", limit_m));
  }
  for (std::uint32_t level = 0; level < parser.levels(); ++level) {
    view.levels.push_back(level_of(parser, level));
  }
  for (std::uint32_t grid = 0; grid < kPlaceGrids.size(); ++grid) {
    view.place_grids.push_back(place_grid_of(parser, grid, view.extent));
  }
  if (view.levels.back().voxels.empty()) parser.refuse("no voxel", "at least one");
  return view;
}

void verify_sections(std::span<const std::byte> bytes, const std::string& name) {
  const Parser parser(bytes, name);
  for (const Section& section : parser.sections()) parser.verify(section);
}

}  // namespace stillmap::localization
