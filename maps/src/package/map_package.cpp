#include <stillmap/maps/map_package.hpp>

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <limits>
#include <set>
#include <stdexcept>
#include <utility>

#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/text.hpp>
#include "package/objects_json.hpp"
#include "package/tile_packs.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

void check_file(const fs::path& file, const MapManifest::File& expected) {
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (status.type() == fs::file_type::not_found) {
    throw InputError(file.string(), "nothing",
                     "a file of the package: copy or build the map again");
  }
  if (error) throw StorageError(file.string(), error.message());
  if (status.type() != fs::file_type::regular) {
    throw InputError(file.string(), "no regular file", "one: copy or build the map again");
  }
  const std::uintmax_t bytes = fs::file_size(file, error);
  if (error) throw StorageError(file.string(), error.message());
  if (bytes != expected.bytes) {
    throw InputError(
        file.string(), std::to_string(bytes) + " bytes",
        std::to_string(expected.bytes) + " as in manifest.json: copy or build the map again");
  }
}

void check_history(const fs::path& file, std::uint64_t bytes, std::uint64_t points) {
  if (bytes == points * sizeof(PointHistory)) return;
  throw InputError(file.string(), std::to_string(bytes) + " bytes",
                   std::to_string(sizeof(PointHistory)) + " for each of the tile's " +
                       std::to_string(points) + " points");
}

/// The records of a file. Its pages need not stay in memory beside them.
template <typename Record>
std::vector<Record> records_of(const MappedFile& file) {
  const std::span<const std::byte> bytes = file.bytes();
  std::vector<Record> records(bytes.size() / sizeof(Record));
  std::memcpy(records.data(), bytes.data(), records.size() * sizeof(Record));
  file.release_pages();
  return records;
}

/// Adding it to a number changes nothing, not even the sign of a zero.
constexpr double kNoOffset = -0.0;

/// Counts one coordinate of the points from a corner instead of the map's origin.
/// @return `corner`; `kNoOffset`, and the points as they were, where a float would not hold the
/// difference: just below the origin, where floats are finest.
double count_from(double corner, float MapPoint::*axis, std::vector<MapPoint>& points) {
  const auto moved = [&](const MapPoint& point) {
    return static_cast<float>(static_cast<double>(point.*axis) - corner);
  };
  const bool all_fit = std::all_of(points.begin(), points.end(), [&](const MapPoint& point) {
    const double back = static_cast<double>(moved(point)) + corner;
    return std::bit_cast<std::uint64_t>(back) ==
           std::bit_cast<std::uint64_t>(static_cast<double>(point.*axis));
  });
  if (!all_fit) return kNoOffset;
  for (MapPoint& point : points) point.*axis = moved(point);
  return corner;
}

/// @param points  as a package of schema 1 has them: relative to the origin.
MapTile tile_of(TileId id, const Eigen::Vector3d& origin, std::vector<MapPoint> points) {
  const double width_m = std::ldexp(kTileSizeM, static_cast<int>(id.level));
  const Eigen::Vector3d corner(count_from(width_m * id.x, &MapPoint::x, points),
                               count_from(width_m * id.y, &MapPoint::y, points), kNoOffset);
  return {origin, corner, std::move(points)};
}

/// @throws InputError if the tiles hold together something else than the manifest says.
void require_extent(const std::vector<TileEntry>& tiles, const MapExtent& told,
                    const fs::path& file) {
  MapExtent found;
  for (const TileEntry& tile : tiles) found.add(tile);
  const auto text = [](const MapExtent& extent) {
    return fmt::format("an extent of {} tiles, {} points, {:.3f} m2", extent.tiles, extent.points,
                       extent.area_m2) +
           (extent.from_origin.isEmpty()
                ? ""
                : fmt::format(", x {:.3f} to {:.3f} m", extent.from_origin.min().x(),
                              extent.from_origin.max().x()));
  };
  constexpr double kRounding = 1e-9;
  const bool same = found.tiles == told.tiles && found.points == told.points &&
                    std::abs(found.area_m2 - told.area_m2) <= kRounding * found.area_m2 &&
                    (found.tiles == 0 || found.from_origin.isApprox(told.from_origin, kRounding));
  if (!same)
    throw InputError(file.string(), text(told),
                     text(found) + " as in the regions: copy or build the map again");
}

/// A number over all drives. @throws InputError for one that no drive has.
template <typename OverAll>
std::uint32_t number_of(DriveNumber what, const std::string& name, const OverAll& over_all) {
  try {
    return over_all(what);
  } catch (const std::out_of_range&) {
    throw InputError(name, fmt::format("number {} of drive {}", what.number, what.drive),
                     "one of manifest.json's drives: copy or build the map again");
  }
}

/// As `MapPoint::object`. @param object  number over all drives.
std::uint8_t short_object(std::uint32_t object) {
  constexpr std::uint32_t kShort = 255;
  return static_cast<std::uint8_t>(1 + object % kShort);
}

/// Calls `take(point, object's number over all drives)` for each point that belongs to an object.
template <typename Take>
void for_each_of_objects(const TileContent& tile, const DriveNumbers& numbers,
                         const std::string& name, const Take& take) {
  for (const auto& [point, object] : tile.of_objects)
    take(point, number_of(object, name,
                          [&](DriveNumber number) { return numbers.object_over_all(number); }));
}

void require_scans_below(const MapObject& object, std::size_t scans, const std::string& file) {
  std::size_t most = std::max(object.first_scan, object.last_scan);
  for (const MapObject::Placement& each : object.placements) most = std::max(most, each.scan);
  if (most >= scans)
    throw InputError(file, fmt::format("scan {} of an object", most),
                     fmt::format("below {}: copy or build the map again", scans));
}

}  // namespace

MapPackage::~MapPackage() = default;

std::shared_ptr<const MapPackage> MapPackage::open(const fs::path& folder) {
  const fs::path manifest_file = folder / kManifestName;
  std::error_code unreadable;
  if (fs::status(manifest_file, unreadable).type() == fs::file_type::not_found) {
    throw InputError(folder.string(), "no manifest.json",
                     "a map package, as `stillmap build` makes it");
  }
  const std::string text = read_text(manifest_file);
  std::shared_ptr<MapPackage> package(new MapPackage);
  package->folder_ = folder;
  package->manifest_ = parse_manifest(text, manifest_file.string());
  package->digest_ = sha256_of(text);
  for (const auto& [path, file] : package->manifest_.files) check_file(folder / path, file);
  if (package->manifest_.schema > 1) {
    package->packs_ = std::make_unique<PackReader>(folder, package->manifest_.files);
    package->numbers_ = std::make_unique<DriveNumbers>(package->manifest_.drives);
    return package;
  }
  for (const TileEntry& tile : package->manifest_.tiles) {
    package->tiles_.try_emplace(tile.id, folder / tile_path(tile.id));
    const auto history = package->manifest_.files.find(history_path(tile.id));
    if (history == package->manifest_.files.end()) continue;
    check_history(folder / history->first, history->second.bytes, tile.points);
    package->histories_.try_emplace(tile.id, folder / history->first);
  }
  return package;
}

void MapExtent::add(const TileEntry& tile) {
  ++tiles;
  from_origin.extend(tile.from_origin());
  // Tiles of higher levels repeat the points of the finest.
  if (tile.id.level != 0) return;
  points += tile.points;
  area_m2 += tile.from_origin().sizes().head<2>().prod();
}

std::vector<TileEntry> MapPackage::tiles() const {
  if (!packs_) return manifest_.tiles;
  std::vector<TileEntry> all;
  for (const RegionId region : packs_->regions())
    for (const TileEntry& tile : packs_->tiles(region)) all.push_back(tile);
  std::sort(all.begin(), all.end(),
            [](const TileEntry& a, const TileEntry& b) { return a.id < b.id; });
  require_extent(all, manifest_.extent, folder_ / kManifestName);
  return all;
}

std::vector<RegionId> MapPackage::regions() const {
  if (packs_) return packs_->regions();
  std::set<RegionId> regions;
  for (const TileEntry& tile : manifest_.tiles)
    if (tile.id.level == 0) regions.insert(region_of(tile.id));
  return {regions.begin(), regions.end()};
}

std::vector<TileEntry> MapPackage::tiles(RegionId region) const {
  if (packs_) return packs_->tiles(region);
  std::vector<TileEntry> tiles;
  std::copy_if(
      manifest_.tiles.begin(), manifest_.tiles.end(), std::back_inserter(tiles),
      [&](const TileEntry& tile) { return tile.id.level == 0 && region_of(tile.id) == region; });
  return tiles;
}

bool MapPackage::has_tile(TileId id) const {
  return packs_ ? packs_->find(id) != nullptr : tiles_.contains(id);
}

std::optional<TileEntry> MapPackage::entry(TileId id) const {
  if (packs_) return packs_->entry(id);
  const auto found = std::find_if(manifest_.tiles.begin(), manifest_.tiles.end(),
                                  [&](const TileEntry& tile) { return tile.id == id; });
  return found == manifest_.tiles.end() ? std::nullopt : std::optional(*found);
}

bool MapPackage::has_history(TileId id) const {
  if (packs_) return has_tile(id) && maps::has_history(packs_->bytes(id), packs_->name_of(id));
  return histories_.contains(id);
}

MapTile MapPackage::tile(TileId id) const {
  if (packs_) {
    if (!has_tile(id)) return {};
    const std::string name = packs_->name_of(id);
    TileContent content = decode_tile(packs_->bytes(id), name, false);
    for_each_of_objects(content, *numbers_, name, [&](std::uint32_t point, std::uint32_t object) {
      content.points[point].object = short_object(object);
    });
    return {manifest_.origin,
            {kTileSizeM * id.x, kTileSizeM * id.y, static_cast<double>(content.z_base_m)},
            std::move(content.points)};
  }
  const auto found = tiles_.find(id);
  if (found == tiles_.end()) return {};
  return tile_of(id, manifest_.origin, records_of<MapPoint>(found->second));
}

std::vector<PointHistory> MapPackage::history(TileId id) const {
  if (packs_) {
    if (!has_tile(id)) return {};
    const std::string name = packs_->name_of(id);
    const TileContent content = decode_tile(packs_->bytes(id), name);
    std::vector<PointHistory> history;
    history.reserve(content.history.size());
    const auto scan_of = [&](DriveNumber scan) {
      return number_of(scan, name,
                       [&](DriveNumber number) { return numbers_->scan_over_all(number); });
    };
    for (const TilePointHistory& each : content.history)
      history.push_back({scan_of(each.first),
                         scan_of(each.last),
                         0,
                         {each.normal[0], each.normal[1], each.normal[2]},
                         each.planarity});
    if (!history.empty())
      for_each_of_objects(content, *numbers_, name, [&](std::uint32_t point, std::uint32_t object) {
        history[point].object = object + 1;
      });
    return history;
  }
  const auto found = histories_.find(id);
  if (found == histories_.end()) return {};
  return records_of<PointHistory>(found->second);
}

TileEvidence MapPackage::evidence(TileId id) const {
  if (!packs_ || !has_tile(id)) return {};
  const std::string name = packs_->name_of(id);
  TileEvidence evidence = decode_evidence(packs_->bytes(id), name);
  for (const TileEvidence::OfDrive& each : evidence.drives)
    if (!numbers_->has_drive(each.drive))
      throw InputError(name, fmt::format("evidence of drive {}", each.drive),
                       "one of manifest.json's drives: copy or build the map again");
  return evidence;
}

MapPackage::StoredName MapPackage::stored_name(TileId id) const {
  if (!has_tile(id)) throw std::invalid_argument(tile_path(id) + ": no tile of the package");
  if (packs_) return {hex_of(packs_->find(id)->sha256), packs_->name_of(id)};
  const std::string path = tile_path(id);
  return {manifest_.files.at(path).sha256, (folder_ / path).string()};
}

std::span<const std::byte> MapPackage::stored_tile(TileId id) const {
  if (packs_) return packs_->bytes(id);
  const auto found = tiles_.find(id);
  return found == tiles_.end() ? std::span<const std::byte>{} : found->second.bytes();
}

std::vector<MapManifest::DriveCounts> MapPackage::drive_counts() const {
  if (!manifest_.drives.empty()) return manifest_.drives;
  const std::vector<Trajectory> paths = trajectories();
  if (paths.empty() && objects().empty()) return {};
  std::vector<MapManifest::DriveCounts> counts(std::max<std::size_t>(1, paths.size()));
  for (std::size_t i = 0; i < paths.size(); ++i)
    counts[i].scans = static_cast<std::uint32_t>(paths[i].size());
  for (const MapObject& object : objects()) ++counts.at(object.drive).objects;
  return counts;
}

std::vector<Trajectory> MapPackage::trajectories() const {
  std::vector<Trajectory> all;
  while (manifest_.files.contains(trajectory_path(all.size())))
    all.push_back(read_tum_trajectory(folder_ / trajectory_path(all.size())));
  return all;
}

ScanFates MapPackage::fates(std::size_t scan) const {
  constexpr std::size_t kMostScans = std::numeric_limits<std::uint32_t>::max();
  DriveNumber of_drive{0, static_cast<std::uint32_t>(std::min(scan, kMostScans))};
  if (numbers_) {
    try {
      of_drive = numbers_->scan(of_drive.number);
    } catch (const std::out_of_range&) {
      throw InputError(folder_.string(), fmt::format("scan {}", scan), "one that a drive has");
    }
  }
  const std::string path = fates_path(of_drive.drive);
  if (!manifest_.files.contains(path)) return {};
  ScanFates fates = read_fates(folder_ / path, of_drive.number);
  for (std::uint32_t& object : fates.objects) {
    if (!numbers_ || object == 0) continue;
    object = 1 + number_of({of_drive.drive, object - 1}, (folder_ / path).string(),
                           [&](DriveNumber number) { return numbers_->object_over_all(number); });
  }
  return fates;
}

std::vector<MapObject> MapPackage::objects() const {
  const auto in_file = [&](const std::string& path) {
    if (!manifest_.files.contains(path)) return std::vector<MapObject>{};
    const fs::path file = folder_ / path;
    return parse_objects(read_text(file), file.string());
  };
  if (manifest_.drives.empty()) return in_file(objects_path(0));
  std::vector<MapObject> all;
  std::size_t scans = 0;
  for (std::size_t drive = 0; drive < manifest_.drives.size(); ++drive) {
    const std::string path = objects_path(drive);
    std::vector<MapObject> own = in_file(path);
    if (own.size() != manifest_.drives[drive].objects)
      throw InputError((folder_ / path).string(), fmt::format("{} objects", own.size()),
                       fmt::format("{} as in manifest.json: copy or build the map again",
                                   manifest_.drives[drive].objects));
    for (MapObject& object : own) {
      require_scans_below(object, manifest_.drives[drive].scans, (folder_ / path).string());
      count_over_all(object, drive, scans);
      all.push_back(std::move(object));
    }
    scans += manifest_.drives[drive].scans;
  }
  return all;
}

std::vector<Eigen::Isometry3d> MapPackage::places() const {
  if (!manifest_.files.contains(kPlacesName)) return {};
  return read_kitti_poses(folder_ / kPlacesName);
}

void MapPackage::release_pages() const {
  for (const auto& [id, file] : tiles_) file.release_pages();
  if (packs_) packs_->release_pages();
}

std::vector<std::string> MapPackage::verify() const {
  std::vector<std::string> broken;
  for (const auto& [path, file] : manifest_.files) {
    try {
      if (sha256_of_file(folder_ / path) != file.sha256) broken.push_back(path);
    } catch (const StorageError&) {
      broken.push_back(path);
    }
  }
  try {
    if (sha256_of_file(folder_ / kManifestName) != digest_) broken.emplace_back(kManifestName);
  } catch (const StorageError&) {
    broken.emplace_back(kManifestName);
  }
  return broken;
}

}  // namespace stillmap::maps
