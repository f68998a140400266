#include "package/tile_packs.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/sha256.hpp>
#include <stillmap/maps/text.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>

#include "storage/write_file.hpp"

namespace stillmap::maps {
namespace {

constexpr const char* kRegionsFolder = "regions";
constexpr const char* kPacksFolder = "packs";

Sha256Bytes sha256_bytes(std::span<const std::byte> bytes) {
  Sha256 hash;
  hash.add(bytes.data(), bytes.size());
  return std::bit_cast<Sha256Bytes>(hash.bytes());
}

std::string tile_name(TileId id) { return fmt::format("tile {}, {}", id.x, id.y); }

/// Bounds in steps, from what the bytes hold.
void set_bounds(const TileContent& tile, RegionTile& row) {
  const auto along = [](float value) {
    return static_cast<std::uint16_t>(static_cast<double>(value) / kTileStepM);
  };
  const auto up = [](float value) {
    return static_cast<std::int32_t>(std::floor(static_cast<double>(value) / kTileStepZM));
  };
  row.min_xy = {std::numeric_limits<std::uint16_t>::max(),
                std::numeric_limits<std::uint16_t>::max()};
  row.min_z = std::numeric_limits<std::int32_t>::max();
  row.max_z = std::numeric_limits<std::int32_t>::min();
  for (const MapPoint& p : tile.points) {
    const std::array<std::uint16_t, 2> xy{along(in_tile_steps(p.x)), along(in_tile_steps(p.y))};
    for (std::size_t axis = 0; axis < 2; ++axis) {
      row.min_xy[axis] = std::min(row.min_xy[axis], xy[axis]);
      row.max_xy[axis] = std::max(row.max_xy[axis], xy[axis]);
    }
    row.min_z = std::min(row.min_z, up(in_height_steps(p.z)));
    row.max_z = std::max(row.max_z, up(in_height_steps(p.z)));
  }
}

}  // namespace

TileEntry entry_of(RegionId region, const RegionTile& tile) {
  const TileId id{
      .level = 0, .x = kRegionTiles * region.x + tile.x, .y = kRegionTiles * region.y + tile.y};
  const auto along = [](std::int32_t number, std::uint16_t step) {
    return kTileSizeM * number + (step + 0.5) * kTileStepM;
  };
  const auto up = [&](std::int32_t step) { return tile.z_base_m + (step + 0.5) * kTileStepZM; };
  return {.id = id,
          .points = tile.points,
          .min = {along(id.x, tile.min_xy[0]), along(id.y, tile.min_xy[1]), up(tile.min_z)},
          .max = {along(id.x, tile.max_xy[0]), along(id.y, tile.max_xy[1]), up(tile.max_z)}};
}

std::string region_path(RegionId region) {
  return fmt::format("{}/{}_{}.node", kRegionsFolder, region.x, region.y);
}

std::optional<RegionId> region_of_path(const std::string& path) {
  RegionId region;
  int end = 0;
  const std::string pattern = std::string(kRegionsFolder) + "/%d_%d.node%n";
  if (std::sscanf(path.c_str(), pattern.c_str(), &region.x, &region.y, &end) != 2 || end == 0)
    return std::nullopt;
  // Spelled in the one way.
  return region_path(region) == path && has_tiles(region) ? std::optional(region) : std::nullopt;
}

std::string hex_of(const Sha256Bytes& digest) {
  std::string text;
  for (const std::byte byte : digest) text += fmt::format("{:02x}", std::to_integer<int>(byte));
  return text;
}

std::string pack_path(const Pack& pack) {
  return fmt::format("{}/{}.pack", kPacksFolder, hex_of(pack.sha256));
}

bool is_pack(const std::string& path) { return path.starts_with(std::string(kPacksFolder) + "/"); }

/// A region that is being written: its tiles lie in a file in the order in which they came.
struct PackWriter::Region {
  std::filesystem::path file;
  std::ofstream out;
  std::uint64_t bytes = 0;
  std::vector<RegionTile> tiles;
};

PackWriter::PackWriter(std::filesystem::path folder) : folder_(std::move(folder)) {
  for (const char* name : {kRegionsFolder, kPacksFolder})
    std::filesystem::create_directories(folder_ / name);
}

PackWriter::~PackWriter() = default;

void PackWriter::add(TileId id, const TileContent& tile) {
  if (id.level != 0) throw std::invalid_argument(tile_name(id) + ": of a level above 0");
  const RegionId number = region_of(id);
  RegionTile row;
  row.x = static_cast<std::uint8_t>(id.x - kRegionTiles * number.x);
  row.y = static_cast<std::uint8_t>(id.y - kRegionTiles * number.y);
  if (const std::unique_ptr<Region>& region = regions_[number];
      region && std::ranges::any_of(region->tiles, [&](const RegionTile& each) {
        return each.x == row.x && each.y == row.y;
      }))
    throw std::invalid_argument(tile_name(id) + ": added twice");
  const std::vector<std::byte> bytes = encode_tile(tile);
  row.points = static_cast<std::uint32_t>(tile.points.size());
  row.z_base_m = tile.z_base_m;
  set_bounds(tile, row);
  row.sha256 = sha256_bytes(bytes);
  append(number, row, bytes);
}

void PackWriter::append(RegionId number, RegionTile row, std::span<const std::byte> bytes) {
  std::unique_ptr<Region>& region = regions_[number];
  if (!region) {
    region = std::make_unique<Region>();
    region->file = folder_ / kPacksFolder / fmt::format("{}_{}.part", number.x, number.y);
  }
  row.offset = region->bytes;
  row.bytes = static_cast<std::uint32_t>(bytes.size());
  // A file is open only while something is written to it: a map may have many regions.
  region->out.open(region->file, std::ios::binary | std::ios::app);
  region->out.write(reinterpret_cast<const char*>(bytes.data()),
                    static_cast<std::streamsize>(bytes.size()));
  region->out.close();
  if (!region->out)
    throw StorageError(region->file.string(), "cannot be written: look at the disk's room");
  region->bytes += bytes.size();
  region->tiles.push_back(row);
}

void PackWriter::take_over(const PackReader& from, std::set<TileId> except) {
  from_ = &from;
  except_ = std::move(except);
  for (const RegionId region : from.regions()) regions_[region];
}

PackWriter::TakenOver PackWriter::taken_over(RegionId number) {
  TakenOver taken;
  if (from_ == nullptr) return taken;
  const RegionNode node = from_->node(number);
  std::vector<std::uint64_t> alive(node.packs.size());
  for (const RegionTile& row : node.tiles) {
    if (except_.contains(entry_of(number, row).id)) continue;
    taken.tiles.push_back(row);
    alive[row.pack] += row.bytes;
  }
  const bool is_touched = regions_.at(number) || taken.tiles.size() < node.tiles.size();
  const auto stays = [&](std::size_t pack) {
    return !is_touched || 2 * alive[pack] >= node.packs[pack].bytes;
  };
  std::erase_if(taken.tiles, [&](const RegionTile& row) {
    if (stays(row.pack)) return false;
    append(number, row, from_->bytes(entry_of(number, row).id));
    return true;
  });
  // Packs keep their order: an untouched node has the same bytes.
  std::vector<std::uint16_t> ours(node.packs.size());
  for (std::size_t i = 0; i < node.packs.size(); ++i) {
    if (alive[i] == 0 || !stays(i)) continue;
    ours[i] = static_cast<std::uint16_t>(taken.packs.size());
    taken.packs.push_back(node.packs[i]);
    link_or_copy(from_->folder() / pack_path(node.packs[i]), folder_ / pack_path(node.packs[i]));
  }
  for (RegionTile& row : taken.tiles) row.pack = ours[row.pack];
  return taken;
}

Pack PackWriter::finished(Region& region) const {
  const std::filesystem::path sorted = region.file.string() + ".sorted";
  Pack pack{.bytes = region.bytes};
  const MappedFile came(region.file);
  std::ofstream out(sorted, std::ios::binary);
  Sha256 hash;
  std::uint64_t offset = 0;
  for (RegionTile& row : region.tiles) {
    // Pages that were read stay otherwise, and a region's tiles may be hundreds of megabytes.
    constexpr std::uint64_t kPagesHeld = std::uint64_t{1} << 24U;
    if (offset / kPagesHeld != (offset + row.bytes) / kPagesHeld) came.release_pages();
    const auto bytes = came.bytes().subspan(row.offset, row.bytes);
    out.write(reinterpret_cast<const char*>(bytes.data()),
              static_cast<std::streamsize>(bytes.size()));
    hash.add(bytes.data(), bytes.size());
    row.offset = std::exchange(offset, offset + row.bytes);
  }
  out.close();
  if (!out) throw StorageError(sorted.string(), "cannot be written: look at the disk's room");
  pack.sha256 = std::bit_cast<Sha256Bytes>(hash.bytes());
  std::filesystem::rename(sorted, folder_ / pack_path(pack));
  std::filesystem::remove(region.file);
  return pack;
}

std::vector<TileEntry> PackWriter::finish() {
  const auto by_place = [](const RegionTile& a, const RegionTile& b) {
    return std::pair(a.x, a.y) < std::pair(b.x, b.y);
  };
  std::vector<TileEntry> tiles;
  for (auto& [number, region] : regions_) {
    TakenOver all = taken_over(number);
    if (region) {
      std::sort(region->tiles.begin(), region->tiles.end(), by_place);
      const Pack pack = finished(*region);
      for (RegionTile& row : region->tiles) row.pack = static_cast<std::uint16_t>(all.packs.size());
      all.packs.push_back(pack);
      all.tiles.insert(all.tiles.end(), region->tiles.begin(), region->tiles.end());
      std::sort(all.tiles.begin(), all.tiles.end(), by_place);
    }
    if (all.tiles.empty()) continue;
    const std::vector<std::byte> node = encode_region({all.packs, all.tiles});
    write_file(folder_ / region_path(number),
               {reinterpret_cast<const char*>(node.data()), node.size()});
    for (const RegionTile& row : all.tiles) tiles.push_back(entry_of(number, row));
  }
  regions_.clear();
  std::sort(tiles.begin(), tiles.end(),
            [](const TileEntry& a, const TileEntry& b) { return a.id < b.id; });
  return tiles;
}

PackReader::PackReader(const std::filesystem::path& folder,
                       const std::map<std::string, MapManifest::File>& files)
    : folder_(folder) {
  for (const auto& [path, file] : files) {
    if (const auto region = region_of_path(path))
      regions_.try_emplace(*region, folder_ / path);
    else if (is_pack(path))
      packs_.try_emplace(path, folder_ / path);
    else if (path.starts_with(std::string(kRegionsFolder) + "/"))
      throw InputError((folder_ / path).string(), "a node of no region",
                       "regions/X_Y.node: copy or build the map again");
  }
}

std::vector<RegionId> PackReader::regions() const {
  std::vector<RegionId> all;
  for (const auto& [id, region] : regions_) all.push_back(id);
  return all;
}

const PackReader::Region& PackReader::region(RegionId id) const {
  static const Region none;
  const auto found = regions_.find(id);
  if (found == regions_.end()) return none;
  Region& region = found->second;
  std::call_once(region.once, [&] {
    const std::string name = (folder_ / region_path(id)).string();
    const RegionNode node = decode_region(region.file->bytes(), name);
    region.packs.clear();
    for (const Pack& pack : node.packs) {
      const auto listed = packs_.find(pack_path(pack));
      const std::size_t bytes = listed == packs_.end() ? 0 : listed->second.bytes().size();
      if (listed == packs_.end() || bytes != pack.bytes)
        throw InputError(name, fmt::format("{} bytes in {}", pack.bytes, pack_path(pack)),
                         fmt::format("{} as in manifest.json: copy or build the map again", bytes));
      region.packs.push_back(&*listed);
    }
    region.node = node;
  });
  return region;
}

std::vector<TileEntry> PackReader::tiles(RegionId id) const {
  std::vector<TileEntry> tiles;
  for (const RegionTile& tile : region(id).node.tiles) tiles.push_back(entry_of(id, tile));
  return tiles;
}

const RegionTile* PackReader::find(TileId id) const {
  if (id.level != 0) return nullptr;
  const RegionId of_tile = region_of(id);
  const auto place = [](int x, int y) { return kRegionTiles * x + y; };
  const int wanted = place(id.x - kRegionTiles * of_tile.x, id.y - kRegionTiles * of_tile.y);
  const std::span<const RegionTile> tiles = region(of_tile).node.tiles;
  const auto at = std::lower_bound(
      tiles.begin(), tiles.end(), wanted,
      [&](const RegionTile& tile, int sought) { return place(tile.x, tile.y) < sought; });
  return at == tiles.end() || place(at->x, at->y) != wanted ? nullptr : &*at;
}

const PackReader::NamedPack& PackReader::pack_of(TileId id, const RegionTile& tile) const {
  return *region(region_of(id)).packs[tile.pack];
}

std::optional<TileEntry> PackReader::entry(TileId id) const {
  const RegionTile* const tile = find(id);
  return tile == nullptr ? std::nullopt : std::optional(entry_of(region_of(id), *tile));
}

std::span<const std::byte> PackReader::bytes(TileId id) const {
  const RegionTile* const tile = find(id);
  if (tile == nullptr) return {};
  return pack_of(id, *tile).second.bytes().subspan(tile->offset, tile->bytes);
}

void PackReader::release_pages() const {
  for (const auto& [path, pack] : packs_) pack.release_pages();
}

std::string PackReader::name_of(TileId id) const {
  const RegionTile* const tile = find(id);
  if (tile == nullptr) throw std::out_of_range(tile_name(id));
  return (folder_ / pack_of(id, *tile).first).string() + ", " + tile_name(id);
}

}  // namespace stillmap::maps
