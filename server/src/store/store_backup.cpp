#include "store/store_backup.hpp"

#include <stillmap/maps/error.hpp>
#include "store/disk_full.hpp"

#include <functional>
#include <set>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "store/durable_files.hpp"
#include "store/folder_lock.hpp"
#include "store/package_copy.hpp"
#include "store/store_folder.hpp"
#include "store/store_upkeep.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

constexpr const char* kNewStateName = ".state.new";

/// Absolute, and without a slash at its end.
fs::path normal(const fs::path& folder) {
  const fs::path path = fs::absolute(folder).lexically_normal();
  return path.has_filename() ? path : path.parent_path();
}

bool has_nothing(const fs::path& folder) {
  std::error_code error;
  const bool empty = fs::is_empty(folder, error);
  if (error) throw maps::StorageError(folder.string(), error.message());
  return empty;
}

/// Makes the folder itself, not those above it, last.
void make_lasting_folder(const fs::path& folder, const DurableFiles& files) {
  if (files.make_folder(folder, kOwnersFolder)) files.sync_folder(folder.parent_path());
}

void check_package(const fs::path& folder, const std::string& digest) {
  const std::shared_ptr<const maps::MapPackage> package = maps::MapPackage::open(folder);
  if (package->digest() != digest)
    throw maps::InputError(folder.string(), "digest " + package->digest(), "that of its name");
  for (const std::string& file : package->verify())
    throw maps::InputError((folder / file).string(), "other bytes",
                           "those that manifest.json says");
}

bool is_whole(const fs::path& folder, const std::string& digest) {
  try {
    check_package(folder, digest);
    return true;
  } catch (const std::runtime_error&) {
    return false;
  }
}

std::set<std::string> digests_of(const StoreState& state) {
  std::set<std::string> digests;
  for (const StoredMap& map : state.maps())
    for (const StoredVersion& version : state.versions(map.name)) digests.insert(version.digest);
  return digests;
}

/// The folder of a backup that is being written, locked.
class BackupFolder {
 public:
  BackupFolder(fs::path folder, DiskCalls& calls)
      : folder_(std::move(folder)),
        packages_(folder_ / kPackagesName),
        calls_(calls),
        files_(calls),
        lock_(marked(folder_, files_) / kLockName) {
    make_lasting_folder(packages_, files_);
    for (const std::string& name : folders_in(packages_))
      if (!is_digest(name)) files_.remove_tree(packages_ / name);
    for (const char* tail : {"", "-journal"})
      if (is_there(new_state().string() + tail)) files_.remove_file(new_state().string() + tail);
  }

  /// @return the packages that it names.
  std::set<std::string> write_state(const StoreState& state) {
    if (is_there(new_state())) files_.remove_file(new_state());
    state.write_backup(new_state(), now_ns(), calls_);
    return digests_of(StoreState(new_state(), StoreState::ReadOnly{"a backup"}));
  }

  [[nodiscard]] bool has(const std::string& digest) const { return is_there(packages_ / digest); }
  /// What is damaged goes by another name until the next backup clears it.
  std::size_t set_damaged_aside() {
    std::size_t damaged = 0;
    for (const std::string& name : folders_in(packages_)) {
      if (is_whole(packages_ / name, name)) continue;
      files_.rename(packages_ / name, packages_ / (kRemoved + name));
      ++damaged;
    }
    files_.sync_folder(packages_);
    return damaged;
  }

  void bring(const fs::path& package, const std::string& digest) {
    const fs::path incoming = packages_ / (kIncoming + digest);
    if (is_there(incoming)) files_.remove_tree(incoming);
    files_.make_folder(incoming);
    if (!link_package(package, incoming, files_)) {
      files_.remove_tree(incoming);
      files_.make_folder(incoming);
      copy_package(package, incoming, files_);
    }
    check_package(incoming, digest);
    files_.rename(incoming, packages_ / digest);
  }

  /// @param is_damaged  whether the package is at fault where the disk fails, not this folder.
  /// @return why it cannot be brought; empty when it was.
  std::string bring_unless_broken(const fs::path& package, const std::string& digest,
                                  const std::function<bool()>& is_damaged) {
    std::string why;
    try {
      bring(package, digest);
      return {};
    } catch (const maps::InputError& error) {
      why = error.what();
    } catch (const DiskFull&) {
      throw;
    } catch (const maps::StorageError& error) {
      if (!is_damaged()) throw;
      why = error.what();
    }
    files_.remove_tree(packages_ / (kIncoming + digest));
    return why;
  }

  /// From here on it is the new backup.
  void commit(const std::set<std::string>& named) {
    files_.sync_folder(packages_);
    files_.rename(new_state(), folder_ / kStateName);
    files_.sync_folder(folder_);
    for (const std::string& name : folders_in(packages_)) {
      if (named.contains(name)) continue;
      const fs::path removed = packages_ / (kRemoved + name);
      files_.rename(packages_ / name, removed);
      files_.remove_tree(removed);
    }
  }

 private:
  [[nodiscard]] fs::path new_state() const { return folder_ / kNewStateName; }

  /// Makes the folder and its mark, or finds it.
  static const fs::path& marked(const fs::path& folder, const DurableFiles& files) {
    make_lasting_folder(folder, files);
    if (is_there(folder / kBackupMark)) return folder;
    if (!has_nothing(folder))
      throw maps::InputError(folder.string(), "something else", "nothing, or an earlier backup");
    files.create(folder / kBackupMark).finish();
    files.sync_folder(folder);
    return folder;
  }

  fs::path folder_, packages_;
  DiskCalls& calls_;
  DurableFiles files_;
  FolderLock lock_;
};

}  // namespace

BackedUp back_up_store(const PackageStore& store, const fs::path& folder) {
  BackupFolder target(normal(folder), store.calls());
  const StoreState& state = store.state();
  while (true) {
    BackedUp done;
    std::string broken;
    const std::set<std::string> named = target.write_state(state);
    bool vanished = false;
    for (const std::string& digest : named) {
      if (target.has(digest)) {
        ++done.kept;
        continue;
      }
      try {
        target.bring(store.local(digest).folder, digest);
      } catch (const std::runtime_error&) {
        if (!store.read_only_because().empty()) throw;
        // Removed since the state was written? Under the lock nothing is.
        const StoreLock lock = store.locked();
        vanished = !state.uses(digest);
        if (vanished) break;
        const std::string why =
            target.bring_unless_broken(store.packages().path_of(digest), digest, [&] {
              PackageBlobs::Verified known;
              return !store.damage_of(digest, known).empty();
            });
        if (!why.empty()) {
          broken += "; " + versions_with(state, digest) + " (" + why + ")";
          continue;
        }
      }
      ++done.copied;
    }
    if (vanished) continue;
    target.commit(named);
    // One that is broken must not keep the others from being saved.
    if (!broken.empty())
      throw maps::InputError(store.folder().string(), "broken packages" + broken,
                             "whole ones; all else is in the backup");
    return done;
  }
}

std::size_t drop_damaged_of_backup(const fs::path& backup, DiskCalls& calls) {
  if (!is_there(backup / kBackupMark)) return 0;
  return BackupFolder(normal(backup), calls).set_damaged_aside();
}

std::size_t restore_store(const fs::path& backup, const fs::path& folder, DiskCalls& calls) {
  const fs::path target = normal(folder);
  if (!is_there(backup / kBackupMark) || !is_there(backup / kStateName))
    throw maps::InputError(backup.string(), "no finished backup", "one that `backup` wrote");
  const StoreState state(backup / kStateName, StoreState::ReadOnly{"a backup"});
  const DurableFiles files(calls);
  make_lasting_folder(target, files);
  if (!has_nothing(target))
    throw maps::InputError(target.string(), "a folder with content", "an empty one");
  // A server that is started meanwhile waits, and opens what is restored.
  const FolderLock lock(target / kLockName);
  if (is_there(target / kStateName))
    throw maps::InputError(target.string(), "a store that was made just now", "an empty folder");
  const fs::path packages = target / kPackagesName;
  make_lasting_folder(packages, files);
  const std::set<std::string> digests = digests_of(state);
  std::string missing;
  for (const std::string& digest : digests) {
    if (!is_there(backup / kPackagesName / digest)) {
      missing += "; " + versions_with(state, digest);
      continue;
    }
    const fs::path incoming = packages / (kIncoming + digest);
    files.make_folder(incoming);
    const CopiedPackage copied = copy_package(backup / kPackagesName / digest, incoming, files);
    check_package(incoming, digest);
    files.rename(incoming, packages / copied.digest);
  }
  files.sync_folder(packages);
  // The last step: without a state nobody takes the folder for a whole store.
  state.write_backup(target / kNewStateName, now_ns(), calls);
  files.rename(target / kNewStateName, target / kStateName);
  files.sync_folder(target);
  if (!missing.empty())
    throw maps::InputError(backup.string(), "no package" + missing,
                           "one for each version; all else is restored");
  return digests.size();
}

}  // namespace stillmap::server
