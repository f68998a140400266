#include "index/index_bytes.hpp"

#include "index/index_format.hpp"

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace stillmap::localization {
namespace {

using index_format::Header;
using index_format::Kind;
using index_format::Section;

std::size_t aligned(std::size_t bytes) {
  return (bytes + index_format::kAlignment - 1) / index_format::kAlignment *
         index_format::kAlignment;
}

const char* name_of(Kind kind) {
  switch (kind) {
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

Header header_of(const IndexKey& key) {
  Header header;
  std::copy_n(key.map_digest.begin(), std::min(key.map_digest.size(), header.map_digest.size()),
              header.map_digest.begin());
  header.levels = static_cast<std::uint32_t>(key.options.levels);
  header.finest_voxel_m = key.options.finest_voxel_m;
  header.min_points = static_cast<std::uint32_t>(key.options.min_points);
  return header;
}

std::uint32_t crc_of(Header header, std::span<const Section> sections) {
  header.crc = 0;
  return maps::crc32c(std::as_bytes(sections), maps::crc32c(std::as_bytes(std::span(&header, 1))));
}

/// A section that is to be written: its bytes and what the table says of it.
struct Part {
  Section section;
  std::span<const std::byte> bytes;
};

template <typename Item>
Part part_of(Kind kind, std::size_t level, std::span<const Item> items) {
  const std::span<const std::byte> bytes = std::as_bytes(items);
  return {{.kind = kind,
           .level = static_cast<std::uint32_t>(level),
           .bytes = bytes.size(),
           .item_bytes = sizeof(Item),
           .crc = maps::crc32c(bytes)},
          bytes};
}

/// Directories first: they are read at load, so they had better share a page with the header.
std::vector<Part> parts_of(const IndexContent& content) {
  std::vector<Part> parts;
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
  Parser(std::span<const std::byte> bytes, const std::string& name) : bytes_(bytes), name_(name) {
    if (bytes.size() < sizeof(Header)) {
      refuse(fmt::format("{} bytes", bytes.size()), "a map index");
    }
    std::memcpy(&header_, bytes.data(), sizeof(Header));
    if (header_.magic != index_format::kMagic) refuse("another kind of file", "a map index");
    if (header_.format != index_format::kFormat) {
      refuse(fmt::format("format {}", header_.format),
             fmt::format("format {}", index_format::kFormat));
    }
    if (header_.file_bytes != bytes.size()) {
      refuse(fmt::format("{} bytes", bytes.size()), fmt::format("{}", header_.file_bytes));
    }
    if (header_.sections > (bytes.size() - sizeof(Header)) / sizeof(Section)) {
      refuse(fmt::format("{} sections", header_.sections), "a section table inside the file");
    }
    sections_.resize(header_.sections);
    const auto table = bytes.subspan(sizeof(Header), header_.sections * sizeof(Section));
    std::copy(table.begin(), table.end(), std::as_writable_bytes(std::span(sections_)).begin());
    if (crc_of(header_, sections_) != header_.crc) {
      refuse("a header that does not fit its checksum", "an undamaged one");
    }
    for (const Section& section : sections_) check(section);
  }

  [[nodiscard]] const Header& header() const { return header_; }
  [[nodiscard]] const std::vector<Section>& sections() const { return sections_; }
  [[noreturn]] void refuse(const std::string& found, const std::string& expected) const {
    throw maps::InputError(name_, found, expected);
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
    for (const Section& section : sections_) {
      if (section.kind == kind && section.level == level) return section;
    }
    refuse(fmt::format("no {} of level {}", name_of(kind), level), "all sections");
  }
  void verify(const Section& section) const {
    if (maps::crc32c(bytes_.subspan(section.offset, section.bytes)) != section.crc) {
      refuse(fmt::format("{} of level {} that do not fit their checksum", name_of(section.kind),
                         section.level),
             "undamaged ones");
    }
  }

 private:
  void check(const Section& section) const {
    if (section.offset % index_format::kAlignment != 0 || section.offset > bytes_.size() ||
        section.bytes > bytes_.size() - section.offset) {
      refuse(fmt::format("{} bytes at {}", section.bytes, section.offset),
             "a section inside the file, aligned to 64 bytes");
    }
  }

  std::span<const std::byte> bytes_;
  std::string name_;
  Header header_;
  std::vector<Section> sections_;
};

void require_key(const Parser& parser, const IndexKey& key) {
  const Header& found = parser.header();
  const Header wanted = header_of(key);
  if (found.map_digest != wanted.map_digest) {
    parser.refuse(fmt::format("an index of map {:.12}",
                              std::string(found.map_digest.begin(), found.map_digest.end())),
                  fmt::format("of map {:.12}", key.map_digest));
  }
  if (found.levels != wanted.levels || found.finest_voxel_m != wanted.finest_voxel_m ||
      found.min_points != wanted.min_points) {
    parser.refuse(
        fmt::format("{} levels, finest voxel {} m, at least {} points", found.levels,
                    found.finest_voxel_m, found.min_points),
        fmt::format("{}, {} m, {}", wanted.levels, wanted.finest_voxel_m, wanted.min_points));
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
      std::ldexp(parser.header().finest_voxel_m,
                 static_cast<int>(parser.header().levels) - 1 - static_cast<int>(level)));
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
  std::vector<Part> parts = parts_of(content);
  std::size_t end = aligned(sizeof(Header) + parts.size() * sizeof(Section));
  std::vector<Section> sections;
  for (Part& part : parts) {
    part.section.offset = end;
    end = aligned(end + part.bytes.size());
    sections.push_back(part.section);
  }
  Header header = header_of(key);
  header.sections = static_cast<std::uint32_t>(sections.size());
  header.file_bytes = end;
  Eigen::Vector3d::Map(header.origin_m.data()) = content.origin;
  Eigen::Vector3d::Map(header.extent_m.data()) = content.extent;
  header.crc = crc_of(header, sections);
  std::vector<CacheLine> lines(end / sizeof(CacheLine));
  const std::span<std::byte> bytes = std::as_writable_bytes(std::span(lines));
  std::memcpy(bytes.data(), &header, sizeof(header));
  std::memcpy(bytes.data() + sizeof(header), sections.data(), sections.size() * sizeof(Section));
  for (const Part& part : parts) {
    if (part.bytes.empty()) continue;
    std::memcpy(bytes.data() + part.section.offset, part.bytes.data(), part.bytes.size());
  }
  return lines;
}

IndexView view_of(std::span<const std::byte> bytes, const IndexKey& key, const std::string& name) {
  const Parser parser(bytes, name);
  require_key(parser, key);
  IndexView view;
  view.origin = Eigen::Vector3d::Map(parser.header().origin_m.data());
  view.extent = Eigen::Vector3d::Map(parser.header().extent_m.data());
  const double limit_m = key.options.finest_voxel_m * kCellsPerAxis;
  // NaN on its own: minCoeff() and maxCoeff() may pass it over.
  if (!(view.origin.allFinite() && view.extent.allFinite() && view.extent.minCoeff() >= 0.0 &&
        view.extent.maxCoeff() < limit_m)) {
    parser.refuse("bounds that no map has", fmt::format("an extent below {} m", limit_m));
  }
  for (std::uint32_t level = 0; level < parser.header().levels; ++level) {
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
