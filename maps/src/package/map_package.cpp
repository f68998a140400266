#include <stillmap/maps/map_package.hpp>

#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/text.hpp>
#include "package/objects_json.hpp"

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

}  // namespace

/// Read-only view of the records of one file for as long as it lives.
template <typename Record>
struct MapPackage::Mapping {
  Mapping(const fs::path& file, std::size_t records) : bytes(records * sizeof(Record)) {
    const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) throw StorageError(file.string(), std::strerror(errno));
    address = ::mmap(nullptr, bytes, PROT_READ, MAP_SHARED, descriptor, 0);
    const int reason = errno;
    ::close(descriptor);
    if (address == MAP_FAILED) throw StorageError(file.string(), std::strerror(reason));
  }
  ~Mapping() { ::munmap(address, bytes); }
  Mapping(const Mapping&) = delete;
  Mapping& operator=(const Mapping&) = delete;

  [[nodiscard]] std::span<const Record> records() const {
    return {static_cast<const Record*>(address), bytes / sizeof(Record)};
  }

  std::size_t bytes;
  void* address = nullptr;
};

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
  for (const TileEntry& tile : package->manifest_.tiles) {
    package->tiles_.emplace(
        tile.id, std::make_unique<Mapping<MapPoint>>(folder / tile_path(tile.id), tile.points));
    const auto history = package->manifest_.files.find(history_path(tile.id));
    if (history == package->manifest_.files.end()) continue;
    check_history(folder / history->first, history->second.bytes, tile.points);
    package->histories_.emplace(
        tile.id, std::make_unique<Mapping<PointHistory>>(folder / history->first, tile.points));
  }
  return package;
}

std::span<const MapPoint> MapPackage::tile(TileId id) const {
  const auto found = tiles_.find(id);
  return found == tiles_.end() ? std::span<const MapPoint>{} : found->second->records();
}

std::span<const PointHistory> MapPackage::history(TileId id) const {
  const auto found = histories_.find(id);
  return found == histories_.end() ? std::span<const PointHistory>{} : found->second->records();
}

std::vector<Trajectory> MapPackage::trajectories() const {
  std::vector<Trajectory> all;
  while (manifest_.files.contains(trajectory_path(all.size())))
    all.push_back(read_tum_trajectory(folder_ / trajectory_path(all.size())));
  return all;
}

ScanFates MapPackage::fates(std::size_t scan) const {
  if (!manifest_.files.contains(kFatesName)) return {};
  return read_fates(folder_ / kFatesName, scan);
}

std::vector<MapObject> MapPackage::objects() const {
  if (!manifest_.files.contains(kObjectsName)) return {};
  const fs::path file = folder_ / kObjectsName;
  return parse_objects(read_text(file), file.string());
}

std::vector<Eigen::Isometry3d> MapPackage::places() const {
  if (!manifest_.files.contains(kPlacesName)) return {};
  return read_kitti_poses(folder_ / kPlacesName);
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
