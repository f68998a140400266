#include "index/index_bytes.hpp"

#include "index/index_format.hpp"
#include "index_grid.hpp"

#include <stillmap/maps/crc32c.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

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
    case Kind::kRegions:
      return "regions";
    case Kind::kPlaces:
      return "places";
    case Kind::kMount:
      return "mount";
    case Kind::kErrors:
      return "errors";
    case Kind::kViews:
      return "views";
  }
  return "unknown";
}

About about_of(const IndexKey& key) {
  About about;
  std::copy_n(key.source.begin(), std::min(key.source.size(), about.source.size()),
              about.source.begin());
  about.finest_voxel_m = key.options.finest_voxel_m;
  about.min_points = static_cast<std::uint32_t>(key.options.min_points);
  return about;
}

template <typename Item>
SectionPart part_of(Kind kind, std::size_t part, std::span<const Item> items) {
  return maps::section_part(static_cast<std::uint32_t>(kind), static_cast<std::uint32_t>(part),
                            std::as_bytes(items), sizeof(Item));
}

SectionPart voxels_part(std::size_t level, const RegionContent& content) {
  return {{.kind = static_cast<std::uint32_t>(Kind::kVoxels),
           .part = static_cast<std::uint32_t>(level),
           .bytes = content.voxels.size(level) * sizeof(Voxel),
           .item_bytes = sizeof(Voxel),
           .crc = content.levels[level].voxels_crc},
          [level, &voxels = content.voxels](const maps::AppendBytes& append) {
            constexpr std::size_t kAtOnce = 1024;
            std::vector<Voxel> some;
            voxels.for_each(level, [&](const CellBlocks::Place&, const Voxel& voxel) {
              some.push_back(voxel);
              if (some.size() < kAtOnce) return;
              append(std::as_bytes(std::span(some)));
              some.clear();
            });
            append(std::as_bytes(std::span(some)));
          }};
}

maps::SectionFile section_file(const maps::SectionFormat& format, const IndexKey& key,
                               const About& about, std::vector<SectionPart> parts) {
  maps::SectionHeader header;
  header.count = static_cast<std::uint32_t>(key.options.levels);
  header.set_about(about);
  return {format, header, std::move(parts)};
}

/// A file of an index whose header and key fit.
class IndexParser {
 public:
  IndexParser(std::span<const std::byte> bytes, const maps::SectionFormat& format,
              const std::string& name)
      : bytes_(bytes),
        table_(bytes, bytes.size(), format, name),
        about_(table_.header().read_about<About>()) {}

  [[nodiscard]] const About& about() const { return about_; }
  [[noreturn]] void refuse(const std::string& found, const std::string& expected) const {
    table_.refuse(found, expected);
  }

  void require(const IndexKey& key) const {
    const About wanted = about_of(key);
    const auto levels = static_cast<std::uint32_t>(key.options.levels);
    if (about_.source != wanted.source) {
      refuse(fmt::format("an index of {:.12}",
                         std::string(about_.source.begin(), about_.source.end())),
             fmt::format("of {:.12}", key.source));
    }
    if (table_.header().count != levels || about_.finest_voxel_m != wanted.finest_voxel_m ||
        about_.min_points != wanted.min_points) {
      refuse(fmt::format("{} levels, finest voxel {} m, at least {} points", table_.header().count,
                         about_.finest_voxel_m, about_.min_points),
             fmt::format("{}, {} m, {}", levels, wanted.finest_voxel_m, wanted.min_points));
    }
  }
  template <typename Item>
  [[nodiscard]] std::span<const Item> items(Kind kind, std::uint32_t part) const {
    const Section& section = section_of(kind, part);
    if (section.item_bytes != sizeof(Item) || section.bytes % sizeof(Item) != 0) {
      refuse(fmt::format("{} of {} bytes", name_of(section.kind), section.item_bytes),
             fmt::format("{}", sizeof(Item)));
    }
    return {reinterpret_cast<const Item*>(bytes_.data() + section.offset),
            section.bytes / sizeof(Item)};
  }
  template <typename Item>
  [[nodiscard]] std::span<const Item> checked_items(Kind kind, std::uint32_t part) const {
    verify(section_of(kind, part));
    return items<Item>(kind, part);
  }
  void verify_all() const {
    for (const Section& section : table_.sections()) verify(section);
  }

 private:
  void verify(const Section& section) const {
    if (maps::crc32c(bytes_.subspan(section.offset, section.bytes)) != section.crc) {
      refuse(fmt::format("{} of level {} that do not fit their checksum", name_of(section.kind),
                         section.part),
             "undamaged ones");
    }
  }
  [[nodiscard]] const Section& section_of(Kind kind, std::uint32_t part) const {
    const Section* section = table_.find(static_cast<std::uint32_t>(kind), part);
    if (section != nullptr) return *section;
    refuse(fmt::format("no {} of level {}", name_of(static_cast<std::uint32_t>(kind)), part),
           "all sections");
  }

  std::span<const std::byte> bytes_;
  maps::SectionTable table_;
  About about_;
};

/// The checksum of its directory is no proof against a file that was made on purpose.
CellBlocks::Part level_part(const IndexParser& parser, std::uint32_t level, double edge_m) {
  CellBlocks::Part part{.tiles = parser.checked_items<CellBlocks::Tile>(Kind::kTiles, level),
                        .slots = parser.items<CellBlocks::Slot>(Kind::kSlots, level),
                        .voxels = parser.items<Voxel>(Kind::kVoxels, level)};
  if (part.voxels.size() >= std::numeric_limits<std::uint32_t>::max())
    parser.refuse("too many voxels", "fewer than 2^32 - 1");
  const int side = cells_of_region(edge_m) >> tile_shift_of(edge_m);
  const std::size_t slots = part.slots.size();
  std::int32_t before = -1;
  for (const CellBlocks::Tile& tile : part.tiles) {
    const std::int32_t place = side * tile.x + tile.y;
    if (tile.x >= side || tile.y >= side || place <= before)
      parser.refuse("tiles out of order", fmt::format("{} by {}, by x, then y", side, side));
    before = place;
    if (tile.slots < 2 || !std::has_single_bit(tile.slots) ||
        tile.shift != CellBlocks::shift_of(tile.slots) || tile.first_slot > slots ||
        tile.slots > slots - tile.first_slot)
      parser.refuse("tiles that lie outside their section", "such that lie inside");
  }
  return part;
}

CellBits::Part place_grid_part(const IndexParser& parser, std::uint32_t grid) {
  CellBits::Part part{.tiles = parser.checked_items<std::uint32_t>(Kind::kGridTiles, grid),
                      .words = parser.items<std::uint64_t>(Kind::kGridWords, grid)};
  const std::size_t side = RegionColumns::tiles(kPlaceGridEdgesM[grid]);
  const bool good = part.tiles.size() == side * side &&
                    std::all_of(part.tiles.begin(), part.tiles.end(), [&](std::uint32_t first) {
                      return first + RegionColumns::kColumnsOfTile <= part.words.size();
                    });
  if (!good) parser.refuse("grid tiles that lie outside their section", "such that lie inside");
  return part;
}

bool is_ascending(std::span<const RegionRow> regions) {
  return std::adjacent_find(regions.begin(), regions.end(),
                            [](const RegionRow& a, const RegionRow& b) { return a.id >= b.id; }) ==
         regions.end();
}

}  // namespace

maps::SectionFile sections_of(const IndexKey& key, const RegionContent& content) {
  About about = about_of(key);
  about.floor = content.floor;
  // Directories first: they are read at load, so they had better share a page with the header.
  std::vector<SectionPart> parts;
  for (std::size_t k = 0; k < content.levels.size(); ++k)
    parts.push_back(part_of(Kind::kTiles, k, content.levels[k].cells.tiles()));
  for (std::size_t k = 0; k < content.place_grids.size(); ++k)
    parts.push_back(part_of(Kind::kGridTiles, k, content.place_grids[k].tiles()));
  for (std::size_t k = 0; k < content.place_grids.size(); ++k)
    parts.push_back(part_of(Kind::kGridWords, k, content.place_grids[k].words()));
  for (std::size_t k = 0; k < content.levels.size(); ++k) {
    parts.push_back(part_of(Kind::kSlots, k, content.levels[k].cells.slots()));
    parts.push_back(voxels_part(k, content));
  }
  return section_file(index_format::kRegionFile, key, about, std::move(parts));
}

RegionView region_view(std::span<const std::byte> bytes, const IndexKey& key,
                       const std::string& name) {
  const IndexParser parser(bytes, index_format::kRegionFile, name);
  parser.require(key);
  RegionView view;
  view.floor = parser.about().floor;
  for (std::uint32_t level = 0; std::cmp_less(level, key.options.levels); ++level)
    view.levels.push_back(level_part(parser, level, edge_of_level(key.options, level)));
  for (std::uint32_t grid = 0; grid < kPlaceGridEdgesM.size(); ++grid)
    view.place_grids.push_back(place_grid_part(parser, grid));
  return view;
}

void verify_region(std::span<const std::byte> bytes, const std::string& name) {
  IndexParser(bytes, index_format::kRegionFile, name).verify_all();
}

void verify_root(std::span<const std::byte> bytes, const std::string& name) {
  IndexParser(bytes, index_format::kRootFile, name).verify_all();
}

maps::SectionFile sections_of(const IndexKey& key, const RootContent& content) {
  About about = about_of(key);
  Eigen::Vector3d::Map(about.min_m.data()) = content.bounds.min();
  Eigen::Vector3d::Map(about.max_m.data()) = content.bounds.max();
  return section_file(
      index_format::kRootFile, key, about,
      {part_of(Kind::kRegions, 0, std::span<const RegionRow>(content.regions)),
       part_of(Kind::kMount, 0, std::span<const double>(content.R_level_lidar.data(), 9)),
       part_of(Kind::kPlaces, 0, std::span<const PlaceRow>(content.places)),
       part_of(Kind::kViews, 0, std::span<const PlaceView>(content.views)),
       part_of(Kind::kErrors, 0, std::span<const OwnErrorColumn>(content.own_errors))});
}

RootView root_view(std::span<const std::byte> bytes, const IndexKey& key, const std::string& name) {
  const IndexParser parser(bytes, index_format::kRootFile, name);
  parser.require(key);
  RootView view;
  const auto min = Eigen::Vector3d::Map(parser.about().min_m.data());
  const auto max = Eigen::Vector3d::Map(parser.about().max_m.data());
  // NaN fails every comparison.
  if (!((min.array() <= max.array()).all() && min.minCoeff() > -kFarthestRegionM &&
        max.maxCoeff() < kFarthestRegionM))
    parser.refuse("bounds that no map has", fmt::format("a box within {} m", kFarthestRegionM));
  view.bounds = Eigen::AlignedBox3d(min, max);
  view.regions = parser.checked_items<RegionRow>(Kind::kRegions, 0);
  if (view.regions.empty() || !is_ascending(view.regions))
    parser.refuse("regions out of order or none", "at least one, by x, then y");
  const auto mount = parser.checked_items<double>(Kind::kMount, 0);
  if (mount.size() != 9) parser.refuse(fmt::format("a mount of {} numbers", mount.size()), "9");
  view.R_level_lidar = Eigen::Matrix3d::Map(mount.data());
  view.places = parser.items<PlaceRow>(Kind::kPlaces, 0);
  view.views = parser.items<PlaceView>(Kind::kViews, 0);
  if (view.views.size() != view.places.size())
    parser.refuse(fmt::format("{} places with {} views", view.places.size(), view.views.size()),
                  "a view of each place");
  view.own_errors = parser.items<OwnErrorColumn>(Kind::kErrors, 0);
  return view;
}

}  // namespace stillmap::localization
