#include <stillmap/maps/derived_leftovers.hpp>
#include <stillmap/maps/error.hpp>
#include "store/package_store.hpp"

#include <algorithm>
#include <map>
#include <utility>

#include "store/durable_files.hpp"
#include "store/folder_lock.hpp"
#include "store/store_folder.hpp"

/// What `PackageStore` removes, clears and checks.
namespace stillmap::server {

namespace fs = std::filesystem;

bool PackageStore::remove(std::string_view map, std::string_view version) {
  const FolderLock lock = locked();
  const std::string digest = state_->version(map, version).digest;
  state_->remove_version(map, version);
  clear_condemned_if_possible();
  return !is_there(package_folder(digest));
}

void PackageStore::remove_map(std::string_view map, WhenActive when_active) {
  const FolderLock lock = locked();
  state_->remove_map(map, when_active);
  clear_condemned_if_possible();
}

std::vector<std::string> PackageStore::keep_newest(std::string_view map, std::size_t count) {
  const FolderLock lock = locked();
  const StoredMap now = state_->map(map);
  std::vector<std::string> others;
  for (const StoredVersion& version : state_->versions(map))
    if (version.name != now.active && version.name != now.previous) others.push_back(version.name);
  others.resize(others.size() - std::min(count, others.size()));
  std::vector<std::string> removed;
  for (const std::string& version : others) {
    try {
      state_->remove_version(map, version);
      removed.push_back(version);
    } catch (const StoreRefusal&) {
      // Activated or removed meanwhile.
    }
  }
  clear_condemned_if_possible();
  return removed;
}

/// The rows are removed, which must not look like a failure; the rest stays noted.
void PackageStore::clear_condemned_if_possible() {
  try {
    state_->even_when_full([&] { clear_condemned(); });
  } catch (const maps::StorageError&) {
    // The next `gc` or open tries again.
  }
}

/// Under the lock. The rename makes it vanish at once; a half deleted package is never seen.
void PackageStore::clear_package(const std::string& digest) {
  const fs::path folder = package_folder(digest);
  const fs::path removed = packages_ / (kRemoved + digest);
  const DurableFiles files(*calls_);
  if (is_there(removed)) files.remove_tree(removed);
  if (!is_there(folder)) return;
  files.rename(folder, removed);
  files.sync_folder(packages_);
  files.remove_tree(removed);
}

void PackageStore::clear_condemned() {
  for (const std::string& digest : state_->condemned()) {
    clear_package(digest);
    DurableFiles(*calls_).sync_folder(packages_);
    state_->forget_condemned(digest);
  }
}

std::size_t PackageStore::clear_leftovers() {
  std::size_t cleared = 0;
  for (const std::string& name : folders_in(packages_)) {
    const fs::path folder = packages_ / name;
    if (is_digest(name)) {
      for (const char* derived : kDerivedFolders)
        cleared += maps::clear_derived_leftovers(folder / derived);
      continue;
    }
    if (name.starts_with(kIncoming)) {
      if (!FolderLock::try_folder(folder)) continue;
    } else if (!name.starts_with(kRemoved)) {
      continue;
    }
    DurableFiles(*calls_).remove_tree(folder);
    ++cleared;
  }
  return cleared;
}

std::vector<std::string> PackageStore::unnamed_packages() const {
  std::vector<std::string> unnamed;
  for (std::string& name : folders_in(packages_))
    if (is_digest(name) && !state_->uses(name)) unnamed.push_back(std::move(name));
  return unnamed;
}

PackageStore::Cleared PackageStore::gc() {
  const FolderLock lock = locked();
  Cleared cleared;
  // A folder may need a block more for the name of what is on its way out.
  state_->even_when_full([&] {
    clear_condemned();
    if (cleared.packages.empty()) cleared.packages = unnamed_packages();
    for (const std::string& digest : cleared.packages) clear_package(digest);
    cleared.leftovers += clear_leftovers();
    DurableFiles(*calls_).sync_folder(packages_);
  });
  return cleared;
}

std::vector<PackageStore::Problem> PackageStore::verify() const {
  std::vector<Problem> problems;
  for (std::string& what : state_->problems()) problems.push_back({{}, {}, std::move(what)});
  // Several versions may name one package; it is read once.
  std::map<std::string, std::string> found;
  for (const StoredMap& map : state_->maps()) {
    for (const StoredVersion& version : state_->versions(map.name)) {
      if (!found.contains(version.digest)) found[version.digest] = damage_of(version.digest);
      // It may have been removed while it was read.
      if (!found[version.digest].empty() && state_->uses(version.digest))
        problems.push_back({map.name, version.name, found[version.digest]});
    }
  }
  return problems;
}

}  // namespace stillmap::server
