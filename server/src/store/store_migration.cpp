#include "store/store_migration.hpp"

#include <stillmap/maps/convert_package.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/text.hpp>
#include "store/disk_full.hpp"
#include "store/free_bytes.hpp"
#include "store/store_upkeep.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>
#include <set>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// Of a package whose manifest cannot be read there is none.
std::optional<maps::MapManifest> manifest_in(const fs::path& package) {
  const fs::path file = package / maps::kManifestName;
  try {
    return maps::parse_manifest(maps::read_text(file), file.string());
  } catch (const maps::InputError&) {
    // `verify` says what is wrong with it.
  } catch (const maps::StorageError&) {
  }
  return std::nullopt;
}

std::uint64_t bytes_freed_with(const fs::path& package, const maps::MapManifest& manifest) {
  std::uint64_t bytes = 0;
  for (const auto& [path, file] : manifest.files) {
    struct stat found {};
    if (::stat((package / path).c_str(), &found) == 0 && found.st_nlink == 1) bytes += file.bytes;
  }
  return bytes;
}

/// How much of a disk is taken while packages come and go.
class RoomCount {
 public:
  void replace(const fs::path& package, const maps::MapManifest& manifest) {
    const maps::ConversionRoom room = maps::conversion_room(manifest);
    used_ += room.package_bytes;
    most_ = std::max(most_, used_ + room.beside_bytes);
    used_ -= std::min(used_, bytes_freed_with(package, manifest));
  }
  [[nodiscard]] std::uint64_t most() const { return most_; }

 private:
  std::uint64_t used_ = 0, most_ = 0;
};

FolderLock lock_against_servers(const fs::path& store) {
  if (auto lock = FolderLock::try_folder(store)) return std::move(*lock);
  throw maps::InputError(
      store.string(), "a store that a server or another migration uses",
      "one that nobody does: stop the server, migrate the store, start the server again");
}

void require_room(const fs::path& store, const MigrationPlan& plan) {
  const std::uint64_t free = free_bytes(store);
  if (plan.packages.empty() || free >= plan.room_bytes) return;
  throw DiskFull(store.string(), std::string(std::strerror(ENOSPC)) + ": " + std::to_string(free) +
                                     " bytes are free, and " + std::to_string(plan.room_bytes) +
                                     " are needed: remove versions or drives, or enlarge the disk");
}

void sync_tree(const fs::path& folder, const DurableFiles& files) {
  std::vector<fs::path> folders = {folder};
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_directory())
      folders.push_back(entry.path());
    else
      files.sync_file(entry.path());
  }
  // Those below before those above.
  std::for_each(folders.rbegin(), folders.rend(),
                [&](const fs::path& each) { files.sync_folder(each); });
}

MigratedPackage migrate_package(PackageStore& store, const PackageOfVersions& former,
                                const maps::DerivedWork& work) {
  const DurableFiles files(store.calls());
  std::optional<StoreLock> lock(store.locked());
  PackageFolder::Incoming incoming(store.packages(), files);
  lock.reset();
  const fs::path package = incoming.path() / "package";
  maps::convert_package(*maps::MapPackage::open(store.packages().path_of(former.digest)), package,
                        work);
  sync_tree(package, files);
  const StoredVersion converted = store.replace(former.digest, incoming, package);
  return {former, converted.digest, converted.bytes};
}

}  // namespace

MigrationPlan plan_migration(const PackageStore& store) {
  if (store.blobs() != nullptr)
    throw maps::InputError(store.folder().string(), "a store with its packages in S3",
                           "one with all of them in its folder: migrate them before they are sent");
  MigrationPlan plan;
  RoomCount room;
  std::set<std::string> seen;
  for (const StoredMap& map : store.state().maps()) {
    for (const StoredVersion& version : store.state().versions(map.name)) {
      if (!seen.insert(version.digest).second) continue;
      const fs::path package = store.packages().path_of(version.digest);
      const std::optional<maps::MapManifest> manifest = manifest_in(package);
      if (!manifest || manifest->schema != 1) continue;
      plan.packages.push_back(
          {version.digest, versions_with(store.state(), version.digest), version.bytes});
      room.replace(package, *manifest);
    }
  }
  plan.room_bytes = room.most();
  return plan;
}

Migration migrate_store(PackageStore& store, const MigrationPlan& plan,
                        const MigrationProgress& progress) {
  const FolderLock alone = lock_against_servers(store.folder());
  require_room(store.folder(), plan);
  std::uint64_t total = 0;
  for (const PackageOfVersions& package : plan.packages) total += package.bytes;
  Migration migration;
  std::uint64_t done = 0;
  for (const PackageOfVersions& package : plan.packages) {
    const auto go_on = [&](double share) {
      const auto bytes = static_cast<std::uint64_t>(share * static_cast<double>(package.bytes));
      return !progress || progress(done + bytes, total, package);
    };
    try {
      migration.migrated.push_back(migrate_package(store, package, {.go_on = go_on}));
    } catch (const maps::InputError& error) {
      migration.left.push_back({package, error.what()});
    }
    done += package.bytes;
  }
  return migration;
}

}  // namespace stillmap::server
