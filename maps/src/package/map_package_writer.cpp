#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <utility>

#include <stillmap/maps/package_files.hpp>
#include "package/drive_numbers.hpp"
#include "package/objects_json.hpp"
#include "package/tile_packs.hpp"
#include "storage/write_file.hpp"

namespace stillmap::maps {
namespace {

static_assert(std::endian::native == std::endian::little, "tiles are little endian as they lie");

TileEntry entry_of(TileId id, std::span<const MapPoint> points) {
  if (points.empty())
    throw std::invalid_argument(tile_path(id) + ": no points, at least one needed");
  TileEntry entry{.id = id, .points = points.size()};
  entry.min = {points[0].x, points[0].y, points[0].z};
  entry.max = entry.min;
  for (const MapPoint& p : points) {
    const std::array<double, 3> xyz{p.x, p.y, p.z};
    for (std::size_t axis = 0; axis < xyz.size(); ++axis) {
      if (!std::isfinite(xyz[axis])) {
        throw std::invalid_argument(tile_path(id) + ": a point that is not finite");
      }
      entry.min[axis] = std::min(entry.min[axis], xyz[axis]);
      entry.max[axis] = std::max(entry.max[axis], xyz[axis]);
    }
  }
  return entry;
}

/// @throws std::invalid_argument for one of no drive.
DriveNumber scan_of(std::uint32_t over_all, const DriveNumbers& numbers) {
  try {
    return numbers.scan(over_all);
  } catch (const std::out_of_range&) {
    throw std::invalid_argument(fmt::format("scan {} of no drive", over_all));
  }
}

DriveNumber object_of(std::uint32_t over_all, const DriveNumbers& numbers) {
  try {
    return numbers.object(over_all);
  } catch (const std::out_of_range&) {
    throw std::invalid_argument(fmt::format("object {} of no drive", over_all));
  }
}

/// @param known  files whose bytes are known.
std::map<std::string, MapManifest::File> hashed_files(
    const std::filesystem::path& folder, const std::string& survivor,
    const std::map<std::string, MapManifest::File>& known) {
  std::map<std::string, MapManifest::File> files;
  for (auto at = std::filesystem::recursive_directory_iterator(folder); at != end(at); ++at) {
    const std::filesystem::directory_entry& entry = *at;
    if (at.depth() == 0 && entry.path().filename() == survivor) at.disable_recursion_pending();
    if (entry.is_directory()) continue;
    if (!entry.is_regular_file() || entry.is_symlink()) {
      throw StorageError(entry.path().string(), "a package holds regular files only");
    }
    const std::string path = entry.path().lexically_relative(folder).generic_string();
    const auto found = known.find(path);
    files[path] = found != known.end()
                      ? found->second
                      : MapManifest::File{entry.file_size(), sha256_of_file(entry.path())};
  }
  return files;
}

}  // namespace

MapPackageWriter::MapPackageWriter(const std::filesystem::path& target, std::string survivor,
                                   int schema)
    : folder_(target, survivor),
      survivor_(std::move(survivor)),
      schema_(schema),
      numbers_(std::make_unique<DriveNumbers>()) {
  if (schema_ > 1) {
    packs_ = std::make_unique<PackWriter>(folder_.path());
  } else {
    std::filesystem::create_directory(folder_.path() / "tiles");
  }
}

MapPackageWriter::~MapPackageWriter() = default;

void MapPackageWriter::add_tile(TileId id, std::span<const MapPoint> points,
                                std::span<const PointHistory> history) {
  if (packs_) {
    const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
    return add_tile(id, MapTile(zero, zero, {points.begin(), points.end()}), history);
  }
  if (std::any_of(tiles_.begin(), tiles_.end(), [&](const TileEntry& t) { return t.id == id; })) {
    throw std::invalid_argument(tile_path(id) + ": added twice");
  }
  const TileEntry entry = entry_of(id, points);
  if (!history.empty() && history.size() != points.size())
    throw std::invalid_argument(history_path(id) + ": not one entry a point");
  write_file(folder_.path() / tile_path(id),
             {reinterpret_cast<const char*>(points.data()), points.size_bytes()});
  if (!history.empty())
    write_file(folder_.path() / history_path(id),
               {reinterpret_cast<const char*>(history.data()), history.size_bytes()});
  tiles_.push_back(entry);
}

void MapPackageWriter::add_tile(TileId id, const MapTile& tile,
                                std::span<const PointHistory> history,
                                const TileEvidence& evidence) {
  if (!packs_) return add_tile(id, MapTile(tile).points_from(Eigen::Vector3d::Zero()), history);
  TileContent content;
  double lowest_m = std::numeric_limits<double>::infinity();
  for (const MapPoint& point : tile) lowest_m = std::min(lowest_m, tile.from_origin(point).z());
  if (!(std::abs(lowest_m) < 1e6))
    throw std::invalid_argument(tile_path(id) + ": no points, or none that is finite");
  content.z_base_m = static_cast<std::int32_t>(std::floor(lowest_m));
  const Eigen::Vector3d corner = corner_of(id) + content.z_base_m * Eigen::Vector3d::UnitZ();
  for (const MapPoint& point : tile)
    content.points.push_back(moved_to(point, tile.from_origin(point) - corner));
  for (const PointHistory& each : history)
    content.history.push_back({scan_of(each.first_scan, *numbers_),
                               scan_of(each.last_scan, *numbers_),
                               {each.normal[0], each.normal[1], each.normal[2]},
                               each.planarity});
  for (std::uint32_t i = 0; i < content.points.size(); ++i) {
    // Without histories the short number is all that is known.
    const std::uint32_t object = history.empty() ? content.points[i].object : history[i].object;
    if (object > 0) content.of_objects.push_back({i, object_of(object - 1, *numbers_)});
  }
  for (const TileEvidence::OfDrive& each : evidence.drives)
    if (!numbers_->has_drive(each.drive))
      throw std::invalid_argument(fmt::format("evidence of drive {}, which is none", each.drive));
  content.evidence = evidence;
  packs_->add(id, content);
}

void MapPackageWriter::set_drives(std::vector<MapManifest::DriveCounts> drives) {
  numbers_ = std::make_unique<DriveNumbers>(std::move(drives));
}

void MapPackageWriter::take_over(const MapPackage& from, std::set<TileId> except) {
  if (!packs_ || !from.packs_)
    throw std::invalid_argument(from.folder().string() + ": a package of schema 1");
  packs_->take_over(*from.packs_, std::move(except));
  for (const auto& [path, file] : from.manifest().files)
    if (is_pack(path)) known_files_[path] = file;
  const std::size_t drives = from.drive_counts().size();
  for (std::size_t drive = 0; drive < drives; ++drive) take_drive(from, drive, drive);
}

void MapPackageWriter::take_drive(const MapPackage& from, std::size_t drive, std::size_t as) {
  for (const auto path_of : {trajectory_path, objects_path, fates_path, disagreement_path}) {
    const auto listed = from.manifest().files.find(path_of(drive));
    if (listed == from.manifest().files.end()) continue;
    link_or_copy(from.folder() / listed->first, folder_.path() / path_of(as));
    known_files_[path_of(as)] = listed->second;
  }
  has_objects_ = true;
}

void MapPackageWriter::add_fates(const ScanFates& fates) {
  if (schema_ == 1) {
    if (!fates_) fates_ = std::make_unique<FatesWriter>(folder_.path() / fates_path(0));
    return fates_->add(fates);
  }
  const DriveNumber scan = scan_of(fates_scans_++, *numbers_);
  if (!fates_ || scan.drive != fates_drive_) {
    if (fates_) fates_->finish();
    fates_drive_ = scan.drive;
    fates_ = std::make_unique<FatesWriter>(folder_.path() / fates_path(scan.drive));
  }
  ScanFates own = fates;
  for (std::uint32_t& object : own.objects) {
    if (object == 0) continue;
    const DriveNumber of_drive = object_of(object - 1, *numbers_);
    if (of_drive.drive != scan.drive)
      throw std::invalid_argument(
          fmt::format("an object of drive {} in a scan of drive {}", of_drive.drive, scan.drive));
    object = of_drive.number + 1;
  }
  fates_->add(own);
}

void MapPackageWriter::write_trajectory(const Trajectory& trajectory, std::size_t drive) {
  write_tum_trajectory(folder_.path() / trajectory_path(drive), trajectory);
}

void MapPackageWriter::write_objects(const std::vector<MapObject>& objects) {
  const std::vector<MapManifest::DriveCounts>& drives = numbers_->drives();
  if (schema_ == 1 || drives.empty()) {
    write_file(folder_.path() / objects_path(0), objects_text(objects));
    return;
  }
  auto at = objects.begin();
  std::uint32_t first_scan = 0;
  for (std::size_t drive = 0; drive < drives.size(); ++drive) {
    std::vector<MapObject> own;
    for (; at != objects.end() && at->drive == drive; ++at) own.push_back(*at);
    if (own.size() != drives[drive].objects)
      throw std::invalid_argument(fmt::format("{} objects of drive {}, {} expected", own.size(),
                                              drive, drives[drive].objects));
    for (MapObject& object : own) count_from_drive(object, first_scan);
    first_scan += drives[drive].scans;
    write_file(folder_.path() / objects_path(drive), objects_text(own));
  }
  if (at != objects.end())
    throw std::invalid_argument(fmt::format("an object of drive {} out of its order", at->drive));
  has_objects_ = true;
}

void MapPackageWriter::write_places(const std::vector<Eigen::Isometry3d>& T_map_place) {
  fmt::memory_buffer text;
  for (const Eigen::Isometry3d& T : T_map_place) {
    if (!T.matrix().allFinite()) throw std::invalid_argument("places: one that is not finite");
    for (Eigen::Index row = 0; row < 3; ++row) {
      fmt::format_to(std::back_inserter(text), "{}{:.7f} {:.7f} {:.7f} {:.3f}", row == 0 ? "" : " ",
                     T(row, 0), T(row, 1), T(row, 2), T(row, 3));
    }
    text.push_back('\n');
  }
  write_file(folder_.path() / kPlacesName, {text.data(), text.size()});
}

std::string MapPackageWriter::publish(MapManifest manifest, const std::string& build_json) {
  if (fates_) std::exchange(fates_, nullptr)->finish();
  const std::vector<MapManifest::DriveCounts>& drives = numbers_->drives();
  const bool needs_objects = std::any_of(drives.begin(), drives.end(),
                                         [](const auto& drive) { return drive.objects > 0; });
  if (schema_ > 1 && needs_objects && !has_objects_)
    throw std::invalid_argument("objects that set_drives told of were not written");
  manifest.schema = schema_;
  manifest.drives = numbers_->drives();
  if (packs_) tiles_ = packs_->finish();
  // Tiles may be added in any order; the digest must not tell.
  std::sort(tiles_.begin(), tiles_.end(),
            [](const TileEntry& a, const TileEntry& b) { return a.id < b.id; });
  manifest.extent = {};
  for (const TileEntry& tile : tiles_) manifest.extent.add(tile);
  manifest.tiles = packs_ ? std::vector<TileEntry>{} : std::move(tiles_);
  manifest.files = hashed_files(folder_.path(), survivor_, known_files_);
  const std::string text = manifest_text(manifest);
  // What we could not open ourselves must not become visible.
  (void)parse_manifest(text, (folder_.target() / kManifestName).string());
  write_file(folder_.path() / kManifestName, text);
  write_file(folder_.path() / kBuildName, build_json);
  folder_.publish();
  return sha256_of(text);
}

}  // namespace stillmap::maps
