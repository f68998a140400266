#include <stillmap/maps/convert_package.hpp>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/pose_disagreement.hpp>
#include <stillmap/maps/text.hpp>
#include <stillmap/maps/tile_steps.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <numeric>
#include <set>
#include <span>
#include <stdexcept>
#include <system_error>
#include <vector>

#include "package/objects_json.hpp"
#include "package/tile_packs.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

/// Each pass goes over the bytes of the package once.
class PassProgress {
 public:
  PassProgress(const DerivedWork& work, const MapManifest& manifest) : work_(work) {
    for (const auto& [path, file] : manifest.files) bytes_ += file.bytes;
  }

  void begin(int pass) {
    pass_ = pass;
    done_ = 0;
  }
  /// @throws WorkStopped.
  void add(std::uint64_t bytes) {
    done_ += bytes;
    const double share = static_cast<double>(done_) / static_cast<double>(bytes_ + 1);
    if (work_.go_on && !work_.go_on((pass_ + share) / kPasses)) throw WorkStopped();
  }

 private:
  static constexpr int kPasses = 3;
  const DerivedWork& work_;
  std::uint64_t bytes_ = 0;
  std::uint64_t done_ = 0;
  int pass_ = 0;
};

void require_whole_files(const MapPackage& map, PassProgress& progress) {
  for (const auto& [path, listed] : map.manifest().files) {
    const fs::path file = map.folder() / path;
    std::string found;
    try {
      found = "SHA-256 " + sha256_of_file(file);
    } catch (const StorageError& error) {
      found = error.what();
    }
    if (found != "SHA-256 " + listed.sha256)
      throw InputError(file.string(), found,
                       listed.sha256 + " as in manifest.json: restore it from a backup");
    progress.add(listed.bytes);
  }
}

/// Where a tile begins, from the map's origin [m].
Eigen::Vector3d corner_of_tile(TileId id) { return {kTileSizeM * id.x, kTileSizeM * id.y, 0.0}; }

/// @param voxel_size_m  0: there are no voxels.
MapTile tile_in_steps(const MapTile& tile, TileId id, const Eigen::Vector3d& origin,
                      double voxel_size_m) {
  const Eigen::Vector3d corner = corner_of_tile(id);
  std::vector<MapPoint> points;
  points.reserve(tile.size());
  for (const MapPoint& point : tile) {
    const Eigen::Vector3d p_tile = tile.from_origin(point) - corner;
    const Eigen::Vector3d begin = (p_tile / voxel_size_m).array().floor() * voxel_size_m;
    const Eigen::Vector3f p =
        voxel_size_m > 0.0 ? in_steps_of_voxel(p_tile, begin, voxel_size_m) : in_steps(p_tile);
    points.push_back(moved_to(point, p.cast<double>()));
  }
  return {origin, corner, std::move(points)};
}

std::uint64_t listed_bytes(const MapManifest& manifest, TileId id) {
  std::uint64_t bytes = 0;
  for (const std::string& path : {tile_path(id), history_path(id)})
    if (const auto file = manifest.files.find(path); file != manifest.files.end())
      bytes += file->second.bytes;
  return bytes;
}

/// What a package of schema 1 says of its drives, as schema 2 numbers it.
class Drives {
 public:
  explicit Drives(const MapPackage& map) : map_(map) {
    for (const Trajectory& drive : map.trajectories())
      counts_.push_back({.scans = static_cast<std::uint32_t>(drive.size()), .objects = 0});
    const std::vector<MapObject> objects = map.objects();
    std::vector<std::uint32_t> order(objects.size());
    std::iota(order.begin(), order.end(), 0U);
    // What a user added came last, whatever its drive.
    if (!counts_.empty())
      std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
        return objects[a].drive < objects[b].drive;
      });
    numbers_.resize(objects.size());
    for (const std::uint32_t before : order) {
      numbers_[before] = static_cast<std::uint32_t>(objects_.size());
      objects_.push_back(objects[before]);
      if (counts_.empty()) continue;
      if (objects[before].drive >= counts_.size())
        throw InputError((map.folder() / objects_path(0)).string(),
                         fmt::format("an object of drive {}", objects[before].drive),
                         fmt::format("one of {} drives", counts_.size()));
      ++counts_[objects[before].drive].objects;
      // A region that a user removed was one object of all drives.
      std::size_t end = 0;
      for (std::size_t drive = 0; drive <= objects[before].drive; ++drive)
        end += counts_[drive].scans;
      objects_.back().last_scan =
          std::min(objects_.back().last_scan, std::max<std::size_t>(end, 1) - 1);
    }
    are_renumbered_ = !std::is_sorted(numbers_.begin(), numbers_.end());
  }

  [[nodiscard]] const std::vector<MapManifest::DriveCounts>& counts() const { return counts_; }
  [[nodiscard]] const std::vector<MapObject>& objects() const { return objects_; }
  /// Whether objects have other numbers than before.
  [[nodiscard]] bool are_renumbered() const { return are_renumbered_; }
  [[nodiscard]] std::vector<PointHistory> history(TileId id) const {
    std::vector<PointHistory> history = map_.history(id);
    for (PointHistory& each : history) each.object = number_of(each.object);
    return history;
  }
  /// Without objects of other drives: a user could remove one region from all drives.
  [[nodiscard]] ScanFates fates(std::size_t drive, std::size_t scan) const {
    ScanFates fates = map_.fates(scan);
    for (std::uint32_t& object : fates.objects) {
      object = number_of(object);
      const bool is_own =
          object > 0 && object <= objects_.size() && objects_[object - 1].drive == drive;
      if (!is_own) object = 0;
    }
    return fates;
  }
  /// Of a scan: numbers over all drives.
  void for_each_scan(const std::function<void(std::size_t drive, std::size_t scan)>& take) const {
    std::size_t scan = 0;
    for (std::size_t drive = 0; drive < counts_.size(); ++drive)
      for (std::uint32_t i = 0; i < counts_[drive].scans; ++i) take(drive, scan++);
  }

 private:
  /// @param object  index plus 1; 0 = none.
  [[nodiscard]] std::uint32_t number_of(std::uint32_t object) const {
    if (object == 0 || numbers_.empty()) return object;
    if (object > numbers_.size())
      throw InputError(map_.folder().string(), fmt::format("object {}", object),
                       fmt::format("at most {}", numbers_.size()));
    return numbers_[object - 1] + 1;
  }

  const MapPackage& map_;
  std::vector<MapManifest::DriveCounts> counts_;
  std::vector<MapObject> objects_;
  /// New numbers by old ones.
  std::vector<std::uint32_t> numbers_;
  bool are_renumbered_ = false;
};

std::uint64_t bytes_of(const MapManifest& manifest, const std::string& path) {
  const auto file = manifest.files.find(path);
  return file == manifest.files.end() ? 0 : file->second.bytes;
}

void write_tiles(const MapPackage& map, const Drives& drives, MapPackageWriter& writer,
                 PassProgress& progress) {
  const MapManifest& manifest = map.manifest();
  for (const TileEntry& entry : manifest.tiles) {
    if (entry.id.level != 0) continue;
    try {
      writer.add_tile(
          entry.id,
          tile_in_steps(map.tile(entry.id), entry.id, manifest.origin, manifest.voxel_size_m),
          drives.history(entry.id));
    } catch (const std::invalid_argument& refused) {
      throw InputError((map.folder() / tile_path(entry.id)).string(), refused.what(),
                       "what a package of schema 2 can hold");
    }
    progress.add(listed_bytes(manifest, entry.id));
  }
}

/// What lies in a file for each drive.
void write_drives(const MapPackage& map, const Drives& drives, MapPackageWriter& writer,
                  PassProgress& progress) {
  if (drives.counts().empty()) return;
  const MapManifest& manifest = map.manifest();
  if (manifest.files.contains(objects_path(0))) writer.write_objects(drives.objects());
  progress.add(bytes_of(manifest, objects_path(0)));
  if (manifest.files.contains(fates_path(0)))
    drives.for_each_scan([&](std::size_t drive, std::size_t scan) {
      writer.add_fates(drives.fates(drive, scan));
      progress.add(0);
    });
  progress.add(bytes_of(manifest, fates_path(0)));
  const std::vector<PoseDisagreement> of_pose = read_pose_disagreements(map);
  std::size_t first = 0;
  for (std::size_t drive = 0; drive < drives.counts().size() && !of_pose.empty(); ++drive) {
    const std::size_t scans = drives.counts()[drive].scans;
    write_pose_disagreements(writer.folder(), std::span(of_pose).subspan(first, scans), drive);
    first += scans;
  }
  progress.add(bytes_of(manifest, disagreement_path(0)));
}

/// Paths of what is written anew. Without drives nothing is by drive.
std::set<std::string> rewritten_paths(const MapManifest& manifest, const Drives& drives) {
  std::set<std::string> paths;
  if (!drives.counts().empty()) paths = {objects_path(0), fates_path(0), disagreement_path(0)};
  for (const TileEntry& entry : manifest.tiles) {
    paths.insert(tile_path(entry.id));
    paths.insert(history_path(entry.id));
  }
  return paths;
}

void copy_other_files(const MapPackage& map, const Drives& drives, const fs::path& folder,
                      PassProgress& progress) {
  const std::set<std::string> rewritten = rewritten_paths(map.manifest(), drives);
  for (const auto& [path, listed] : map.manifest().files) {
    if (rewritten.contains(path)) continue;
    std::error_code error;
    fs::create_directories((folder / path).parent_path(), error);
    if (!fs::copy_file(map.folder() / path, folder / path, error) || error)
      throw StorageError((folder / path).string(), error.message());
    progress.add(listed.bytes);
  }
}

/// What differs between a point of the package and the same in steps, besides its object; empty
/// when nothing does.
std::string difference(const MapPoint& before, const MapPoint& after,
                       const Eigen::Vector3d& moved_m) {
  constexpr double kRounding = 1e-9;
  const Eigen::Array3d most(kTileStepM, kTileStepM, kTileStepZM);
  if (!(moved_m.array().abs() <= most + kRounding).all())
    return fmt::format("a point {:.3f} {:.3f} {:.3f} m from its place in steps", moved_m.x(),
                       moved_m.y(), moved_m.z());
  const bool same = before.observations == after.observations && before.kind == after.kind &&
                    in_intensity_steps(before.intensity) == after.intensity;
  return same ? "" : "a point that reads back otherwise";
}

bool same_history(const PointHistory& a, const PointHistory& b) {
  return a.first_scan == b.first_scan && a.last_scan == b.last_scan && a.object == b.object &&
         std::equal(a.normal, a.normal + 3, b.normal) && a.planarity == b.planarity;
}

void require_same_tile(const MapPackage& before, const Drives& drives, const MapPackage& after,
                       TileId id) {
  const auto refuse = [&](const std::string& what) {
    throw InputError((before.folder() / tile_path(id)).string(), what,
                     "points that schema 2 can hold");
  };
  const MapTile from = before.tile(id), to = after.tile(id);
  if (from.size() != to.size()) refuse(fmt::format("{} points, now {}", from.size(), to.size()));
  for (std::size_t i = 0; i < from.size(); ++i) {
    const std::string what =
        difference(from[i], to[i], to.from_origin(to[i]) - from.from_origin(from[i]));
    if (!what.empty()) refuse(what);
  }
  const std::vector<PointHistory> was = drives.history(id), is = after.history(id);
  if (!std::equal(was.begin(), was.end(), is.begin(), is.end(), same_history))
    refuse("a history that reads back otherwise");
  const auto same_object = [](const MapPoint& a, const MapPoint& b) {
    return a.object == b.object;
  };
  if (!drives.are_renumbered() && !std::equal(from.begin(), from.end(), to.begin(), same_object))
    refuse("a point that reads back otherwise: its object");
}

/// The package that is replaced may be removed after this.
void require_same(const MapPackage& before, const Drives& drives, const MapPackage& after,
                  PassProgress& progress) {
  for (const TileEntry& entry : before.manifest().tiles) {
    if (entry.id.level != 0) continue;
    require_same_tile(before, drives, after, entry.id);
    progress.add(listed_bytes(before.manifest(), entry.id));
  }
  const auto refuse = [&](const std::string& path) {
    throw StorageError((after.folder() / path).string(), "reads back otherwise");
  };
  if (objects_text(after.objects()) != objects_text(drives.objects())) refuse(objects_path(0));
  progress.add(bytes_of(before.manifest(), objects_path(0)));
  drives.for_each_scan([&](std::size_t drive, std::size_t scan) {
    if (after.fates(scan) != drives.fates(drive, scan)) refuse(fates_path(drive));
    progress.add(0);
  });
  progress.add(bytes_of(before.manifest(), fates_path(0)));
  const std::set<std::string> rewritten = rewritten_paths(before.manifest(), drives);
  for (const auto& [path, file] : after.manifest().files) {
    const auto listed = before.manifest().files.find(path);
    if (listed == before.manifest().files.end() || rewritten.contains(path)) continue;
    if (listed->second.sha256 != file.sha256) refuse(path);
  }
}

std::string build_text(const fs::path& folder) {
  const fs::path file = folder / kBuildName;
  return fs::exists(file) ? read_text(file) : "{}\n";
}

}  // namespace

std::string convert_package(const MapPackage& map, const fs::path& target,
                            const DerivedWork& work) {
  if (map.manifest().schema != 1)
    throw std::invalid_argument(map.folder().string() + ": of schema " +
                                std::to_string(map.manifest().schema) + ", 1 expected");
  PassProgress progress(work, map.manifest());
  require_whole_files(map, progress);
  const Drives drives(map);
  std::string digest;
  {
    MapPackageWriter writer(target, {}, kPackageSchema);
    progress.begin(1);
    writer.set_drives(drives.counts());
    write_tiles(map, drives, writer, progress);
    write_drives(map, drives, writer, progress);
    copy_other_files(map, drives, writer.folder(), progress);
    digest = writer.publish(map.manifest(), build_text(map.folder()));
  }
  progress.begin(2);
  try {
    require_same(map, drives, *MapPackage::open(target), progress);
  } catch (...) {
    std::error_code ignored;
    fs::remove_all(target, ignored);
    throw;
  }
  return digest;
}

ConversionRoom conversion_room(const MapManifest& manifest) {
  constexpr std::uint64_t kMostOfPoint = 20, kMostWithHistory = 32;
  // Head and gaps of a tile, its row in the region's node.
  constexpr std::uint64_t kMostOfTile = 400;
  ConversionRoom room;
  std::map<RegionId, std::uint64_t> packs;
  for (const TileEntry& entry : manifest.tiles) {
    if (entry.id.level != 0) continue;
    const bool has_history = manifest.files.contains(history_path(entry.id));
    const std::uint64_t bytes =
        (has_history ? kMostWithHistory : kMostOfPoint) * entry.points + kMostOfTile;
    room.package_bytes += bytes;
    // A region's pack is written twice, once in the order of its tiles.
    std::uint64_t& pack = packs[region_of(entry.id)];
    pack += bytes;
    room.beside_bytes = std::max(room.beside_bytes, pack);
  }
  std::set<std::string> of_tiles;
  for (const TileEntry& entry : manifest.tiles)
    of_tiles.insert({tile_path(entry.id), history_path(entry.id)});
  for (const auto& [path, file] : manifest.files)
    if (!of_tiles.contains(path)) room.package_bytes += file.bytes;
  return room;
}

}  // namespace stillmap::maps
