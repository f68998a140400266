#include "store/package_store.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_graph.hpp>
#include "store/map_name.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <stdexcept>
#include <system_error>
#include <utility>

#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/text.hpp>
#include "store/archive_files.hpp"
#include "store/durable_files.hpp"
#include "store/folder_lock.hpp"
#include "store/incoming_package.hpp"
#include "store/package_copy.hpp"
#include "store/postgres_database.hpp"
#include "store/store_folder.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

void check_name(const char* what, std::string_view name) {
  if (is_valid_map_name(name)) return;
  throw std::invalid_argument(std::string(what) + ": '" + std::string(name) +
                              "', [a-z0-9][a-z0-9._-]{0,62} expected");
}

/// Opens it and reads the parts that are only read at need.
void check_readable(const fs::path& folder) {
  const std::shared_ptr<const maps::MapPackage> package = maps::MapPackage::open(folder);
  (void)package->tiles();
  (void)package->trajectories();
  (void)package->objects();
  (void)maps::read_map_graph(*package);
}

/// What a package is as a version, made now.
StoredVersion version_in(const fs::path& package, std::string_view name) {
  const fs::path manifest_file = package / maps::kManifestName;
  const std::string text = maps::read_text(manifest_file);
  StoredVersion version{.name = std::string(name), .digest = maps::sha256_of(text)};
  version.files = {{version.digest, text.size()}};
  for (const auto& [path, file] : maps::parse_manifest(text, manifest_file.string()).files) {
    version.bytes += file.bytes;
    version.files.emplace(file.sha256, file.bytes);
  }
  version.bytes += text.size();
  version.created_ns = now_ns();
  return version;
}

/// @param name  of what they came with, for messages. @throws InputError for one of something else.
std::vector<MapSignature> checked(std::vector<MapSignature> signatures, std::string_view map,
                                  const std::string& digest, const std::string& name) {
  for (const MapSignature& each : signatures)
    if (!is_signature_of(each, map, digest))
      throw maps::InputError(name, "a signature by " + each.key + " of something else",
                             "of map '" + std::string(map) + "' and package " + digest +
                                 ": sign it again with `stillmap keys sign`");
  return signatures;
}

std::string not_signed_text(std::string_view map, const std::string& version,
                            const std::string& digest) {
  return "no trusted key has signed version '" + version + "' of map '" + std::string(map) + "' (" +
         digest + "): sign it with `stillmap keys sign`, or add its key to trusted_keys_file";
}

/// When a file in a folder was read or written last; what the disk does not tell is new.
std::int64_t last_use_ns(const fs::path& folder) {
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  std::int64_t last = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    struct stat found {};
    if (::stat(entry.path().c_str(), &found) != 0) return INT64_MAX;
    for (const timespec& time : {found.st_atim, found.st_mtim})
      last = std::max(last, kSecond_ns * time.tv_sec + time.tv_nsec);
  }
  return last;
}

void refuse_unwanted(const std::optional<PackageStore::Maker>& maker) {
  if (!maker || !maker->is_unwanted || !maker->is_unwanted()) return;
  throw StoreRefusal(
      StoreRefusal::Reason::kNotProcessing,
      "the package of job " + std::to_string(maker->job.id) + " is not wanted any more");
}

/// Nothing where the state is in the folder. @throws InputError, StorageError.
std::optional<PostgresAddress> state_address(const fs::path& folder) {
  const fs::path file = folder / kStateAddressName;
  if (!is_there(file)) return std::nullopt;
  std::ifstream stream(file);
  std::string text;
  if (!std::getline(stream, text)) throw maps::StorageError(file.string(), "cannot be read");
  if (!PostgresAddress::is_one(text))
    throw maps::InputError(file.string(), "no address of PostgreSQL",
                           "one line that begins with postgres://");
  return PostgresAddress(text);
}

}  // namespace

PackageStore::PackageStore(const fs::path& folder, DiskCalls& calls,
                           std::unique_ptr<PackageBlobs> blobs)
    : folder_(fs::absolute(folder).lexically_normal()),
      calls_(&calls),
      blobs_(std::move(blobs)),
      packages_(blobs_ ? blobs_->packages() : folder_ / kPackagesName, calls) {
  if (is_there(folder_ / kBackupMark))
    throw maps::InputError(folder_.string(), "a backup of a store",
                           "a store: restore it elsewhere");
  std::optional<FolderLock> lock;
  try {
    lock.emplace(folder_ / kLockName);
    if (!blobs_) {
      refuse_lost_state();
      const DurableFiles files(calls);
      // Before the state: where there is a state, there is a folder for its packages.
      if (files.make_folder(packages_.path())) files.sync_folder(folder_);
    }
  } catch (const maps::StorageError& error) {
    open_read_only(error);
    return;
  }
  if (const std::optional<PostgresAddress> address = state_address(folder_))
    state_ = std::make_unique<StoreState>(*address);
  else
    state_ = std::make_unique<StoreState>(folder_ / kStateName, calls);
  // What is elsewhere may be out of reach, which must not hold up the start.
  if (!read_only_because().empty() || blobs_) return;
  try {
    clear_condemned();
    packages_.clear_leftovers();
    note_files();
  } catch (const maps::StorageError& error) {
    // A full or failing disk must not keep maps from being served.
    not_cleared_because_ = error.what();
  }
}

PackageStore::~PackageStore() = default;

bool PackageStore::make_folder(const fs::path& folder, DiskCalls& calls) {
  std::error_code error;
  if (fs::is_directory(folder, error)) return false;
  fs::path path = fs::absolute(folder).lexically_normal();
  // Of `maps/`, the part before the slash.
  if (!path.has_filename()) path = path.parent_path();
  const DurableFiles files(calls);
  if (!files.make_folder(path, kOwnersFolder)) return false;
  files.sync_folder(path.parent_path());
  return true;
}

void PackageStore::attach(const fs::path& folder, const PostgresAddress& address,
                          DiskCalls& calls) {
  const fs::path file = folder / kStateAddressName;
  const auto known = state_address(folder);
  if (known && known->text() == address.text()) return;
  if (known)
    throw maps::InputError(file.string(), known->name(),
                           address.name() +
                               ", or no such file: stop all servers on this folder and "
                               "remove the file, if the state has moved");
  if (is_there(folder / kStateName))
    throw maps::InputError((folder / kStateName).string(), "a state of its own",
                           "none: `stillmap store copy` moves it to PostgreSQL");
  const DurableFiles files(calls);
  DurableFiles::NewFile text = files.create(file);
  // It may hold a password.
  fs::permissions(file, fs::perms::owner_read | fs::perms::owner_write);
  text.append(address.text() + "\n");
  text.finish();
  files.sync_folder(folder);
}

bool PackageStore::is_store(const fs::path& folder) {
  return is_there(folder / kStateName) || is_there(folder / kStateAddressName);
}

/// A disk on which not even the lock's file can be made may still hold all that is to be served.
void PackageStore::open_read_only(const maps::StorageError& reason) {
  try {
    state_ =
        std::make_unique<StoreState>(folder_ / kStateName, StoreState::ReadOnly{reason.what()});
  } catch (const maps::StorageError&) {
    throw maps::StorageError(reason);
  }
}

void PackageStore::set_quota(const StoreQuota& quota) {
  const std::scoped_lock lock(quota_mutex_);
  quota_ = quota;
}

StoreQuota PackageStore::quota() const {
  const std::scoped_lock lock(quota_mutex_);
  return quota_;
}

void PackageStore::set_trust(const std::optional<PublicKeys>& keys) {
  const std::scoped_lock lock(trust_mutex_);
  trust_ = keys;
}

void PackageStore::require_signed(std::string_view map, std::string_view version) const {
  // Asked with each scan of a session.
  if (trust()) require_trust(map, state_->version(map, version));
}

std::optional<PublicKeys> PackageStore::trust() const {
  const std::scoped_lock lock(trust_mutex_);
  return trust_;
}

void PackageStore::require_trust(std::string_view map, const StoredVersion& version) const {
  const std::optional<PublicKeys> keys = trust();
  if (!keys || is_signed_by(*keys, version.signatures, map, version.digest) ||
      is_signed_by(*keys, state_->signatures().of(map, version.digest), map, version.digest))
    return;
  throw StoreRefusal(StoreRefusal::Reason::kNotSigned,
                     not_signed_text(map, version.name, version.digest));
}

std::map<std::pair<std::string, std::string>, std::string> PackageStore::not_signed(
    const PackageDigests& versions) const {
  std::map<std::pair<std::string, std::string>, std::string> refused;
  const std::optional<PublicKeys> keys = trust();
  if (!keys) return refused;
  const auto signatures = state_->signatures().all();
  for (const auto& [name, digest] : versions) {
    const auto found = signatures.find({name.first, digest});
    if (found == signatures.end() || !is_signed_by(*keys, found->second, name.first, digest))
      refused.emplace(name, not_signed_text(name.first, name.second, digest));
  }
  return refused;
}

void PackageStore::check_quota(std::string_view map, std::uint64_t more_bytes,
                               const WaitingBytes& waiting) const {
  state_->check_quota(quota(), map, more_bytes, waiting);
  check_disk_reserve(more_bytes);
}

void PackageStore::check_disk_reserve(const fs::path& folder, std::uint64_t more_bytes) const {
  const std::uint64_t reserve = quota().disk_reserve.value_or(0);
  if (reserve == 0) return;
  const std::uint64_t free = fs::space(folder).available;
  if (free >= reserve && more_bytes <= free - reserve) return;
  throw StoreRefusal(
      StoreRefusal::Reason::kDiskReserve,
      "the disk has " + std::to_string(free) + " bytes free, of which " + std::to_string(reserve) +
          " are reserved so that keys can be revoked and maps removed; there is no "
          "room for " +
          std::to_string(more_bytes) + " more: remove versions or drives, or enlarge the disk");
}

ByteSource PackageStore::leaving_reserve(const ByteSource& source) const {
  return [this, source](std::span<char> to) {
    check_disk_reserve(blobs_ ? packages_.path() : folder_, 0);
    return source(to);
  };
}

void PackageStore::refuse_lost_state() const {
  std::error_code error;
  const fs::path file = folder_ / kStateName;
  if (is_there(file) && fs::file_size(file, error) > 0) return;
  if (is_there(folder_ / kStateAddressName)) return;
  if (!is_there(packages_.path())) return;
  // Also what a restore left that came no further.
  if (folders_in(packages_.path()).empty()) return;
  throw maps::InputError(file.string(), "nothing, though there are packages beside it",
                         "the state that names them: put it back, name the one in PostgreSQL "
                         "(`stillmap store attach`), or move the packages away");
}

std::shared_ptr<const maps::MapPackage> PackageStore::open(std::string_view map,
                                                           std::string_view version) const {
  const PackageBlobs::Local found = local(state_->version(map, version).digest);
  std::shared_ptr<const maps::MapPackage> package = maps::MapPackage::open(found.folder);
  if (!found.pin) return package;
  // It stays on the disk while it is open.
  struct Pinned {
    std::shared_ptr<void> pin;
    std::shared_ptr<const maps::MapPackage> package;
  };
  const auto both = std::make_shared<Pinned>(Pinned{found.pin, package});
  return {both, package.get()};
}

maps::MapManifest PackageStore::manifest(std::string_view map, std::string_view version) const {
  const std::string digest = state_->version(map, version).digest;
  if (blobs_) return blobs_->manifest_if_near(digest);
  return maps::MapPackage::open(packages_.path_of(digest))->manifest();
}

PackageBlobs::Local PackageStore::local(const std::string& digest) const {
  if (blobs_) return blobs_->bring(digest);
  return {packages_.path_of(digest), nullptr};
}

std::optional<PackageBlobs::Local> PackageStore::find_local(const std::string& digest) const {
  if (blobs_) return blobs_->find_local(digest);
  return local(digest);
}

std::string PackageStore::damage_of(const std::string& digest,
                                    PackageBlobs::Verified& known) const {
  return blobs_ ? blobs_->damage_of(digest, known) : packages_.damage_of(digest);
}

bool PackageStore::is_stored(const std::string& digest) const {
  return blobs_ ? state_->uses(digest) : packages_.has(digest);
}

bool PackageStore::is_whole(const std::string& digest) const {
  if (!blobs_) return packages_.has_whole(digest);
  PackageBlobs::Verified known;
  return state_->uses(digest) && blobs_->damage_of(digest, known).empty();
}

StoredVersion PackageStore::version_of(const std::string& digest, std::string_view name) const {
  return version_in(local(digest).folder, name);
}

void PackageStore::send(const fs::path& package, const std::string& digest) const {
  if (!blobs_) return;
  // One that is used and was not found whole: each of its files may be the wrong one.
  const bool is_damaged = state_->uses(digest);
  blobs_->send(package, is_damaged ? FileBytes() : state_->files(), is_damaged);
}

std::unique_ptr<PackageFolder::Incoming> PackageStore::begin_incoming(
    const DurableFiles& files) const {
  std::optional<FolderLock> of_blobs;
  if (blobs_) of_blobs.emplace(blobs_->locked());
  return std::make_unique<PackageFolder::Incoming>(packages_, files);
}

std::uint64_t PackageStore::copy_of(const std::string& digest) const {
  // A damaged one does not come to the local disk.
  if (blobs_) return 1;
  struct stat found {};
  const fs::path folder = packages_.path_of(digest);
  return ::stat(folder.c_str(), &found) == 0 ? static_cast<std::uint64_t>(found.st_ino) : 0;
}

PackageStore::Added PackageStore::add(std::string_view map, std::string_view version,
                                      const fs::path& package, const std::optional<Maker>& maker) {
  check_name("map", map);
  check_name("version", version);
  StoredVersion wanted = version_in(package, version);
  wanted.signatures = checked(signatures_beside(package), map, wanted.digest, package.string());
  if (!maker) require_trust(map, wanted);

  // Before gigabytes are copied.
  state_->check_version(map, wanted, quota());
  const auto known = state_->find_version(map, version);
  const bool whole = find_whole(map, wanted);
  if (known && whole && !maker) {
    state_->signatures().add(map, wanted.digest, wanted.signatures);
    state_->require_current();
    return {*known, false};
  }
  const DurableFiles files(*calls_);
  std::optional<StoreLock> lock(locked());
  const auto job = maker ? std::optional(maker->job) : std::nullopt;
  if (whole && is_stored(wanted.digest)) return commit(map, wanted, job);
  const auto incoming = begin_incoming(files);
  lock.reset();
  const CopiedPackage copied =
      copy_package(package, incoming->path(), files, [&] { refuse_unwanted(maker); });
  if (copied.digest != wanted.digest)
    throw maps::InputError((package / maps::kManifestName).string(), "a file that changes",
                           "one that does not: add it when its writer has ended");
  check_readable(incoming->path());
  // A damaged copy that is being replaced gives nothing.
  if (!blobs_) share_files(incoming->path(), files_of_versions(map, wanted.digest), files);
  send(incoming->path(), wanted.digest);
  lock.emplace(locked());
  refuse_unwanted(maker);
  return publish(*incoming, incoming->path(), map, wanted, job);
}

PackageStore::Added PackageStore::add_archive(std::string_view map, std::string_view version,
                                              const IncomingArchive& archive,
                                              const std::optional<std::string>& sha256) {
  check_name("map", map);
  check_name("version", version);
  const DurableFiles files(*calls_);
  std::optional<StoreLock> lock(locked());
  const auto incoming = begin_incoming(files);
  const auto taken = blobs_ ? begin_incoming(files) : nullptr;
  lock.reset();
  const ArchiveFiles found =
      unpack_archive({leaving_reserve(archive.source), archive.name, archive.limits},
                     incoming->path(), files, /*hashed=*/true);
  if (sha256 && *sha256 != found.archive.sha256)
    throw maps::InputError(archive.name, "SHA-256 " + found.archive.sha256,
                           *sha256 + " as announced: send it again");
  const IncomingPackage package =
      keep_package(incoming->path(), found, archive.name, files, files_to_take(map, taken.get()));
  StoredVersion wanted = version_in(package.folder, version);
  wanted.signatures = checked(package.signatures, map, wanted.digest, archive.name);
  require_trust(map, wanted);
  check_readable(package.folder);
  if (!blobs_) share_files(package.folder, files_of_versions(map, wanted.digest), files);
  const bool whole = find_whole(map, wanted);
  if (!whole) send(package.folder, wanted.digest);
  lock.emplace(locked());
  if (whole && is_stored(wanted.digest)) return commit(map, wanted);
  return publish(*incoming, package.folder, map, wanted);
}

std::unique_ptr<PackageArchive> PackageStore::archive(std::string_view map,
                                                      std::string_view version,
                                                      std::string_view without) const {
  const PackageBlobs::Local package = local(state_->version(map, version).digest);
  std::unique_ptr<PackageArchive> archive;
  if (without.empty()) {
    archive = std::make_unique<PackageArchive>(package.folder);
  } else {
    require_version_of(map, without);
    const PackageBlobs::Local other = local(std::string(without));
    archive = std::make_unique<PackageArchive>(package.folder, other.folder);
  }
  if (package.pin) archive->keep(package.pin);
  return archive;
}

maps::PackageDelta PackageStore::delta(std::string_view map, std::string_view version,
                                       std::string_view from) const {
  for (const StoredVersion& each : state_->versions(map))
    if (each.digest == from)
      return maps::package_delta(manifest(map, each.name), manifest(map, version));
  require_version_of(map, from);
  return {};
}

void PackageStore::require_version_of(std::string_view map, std::string_view digest) const {
  for (const StoredVersion& version : state_->versions(map))
    if (version.digest == digest) return;
  throw StoreRefusal(StoreRefusal::Reason::kUnknownVersion,
                     "map '" + std::string(map) + "' has no version of the digest '" +
                         std::string(digest) + "'; ask for the whole version");
}

std::string PackageStore::damage_of(const PackageArchive& archive) const {
  const std::string state = archive.files_state();
  const auto known = [&]() -> std::optional<std::string> {
    const std::scoped_lock lock(compared_mutex_);
    const auto found = compared_.find(archive.digest());
    if (found == compared_.end() || found->second.files_state != state) return std::nullopt;
    return found->second.first_damaged;
  };
  // What is known waits for no other package.
  if (const auto damaged = known()) return *damaged;
  const std::scoped_lock one_at_a_time(comparing_mutex_);
  if (const auto damaged = known()) return *damaged;
  std::string damaged = archive.first_damaged();
  const std::scoped_lock lock(compared_mutex_);
  compared_.insert_or_assign(archive.digest(), Compared{state, damaged});
  return damaged;
}

/// Under the lock. What is refused leaves no package: without a row no quota would count it.
PackageStore::Added PackageStore::publish(PackageFolder::Incoming& incoming,
                                          const fs::path& package, std::string_view map,
                                          const StoredVersion& version,
                                          const std::optional<JobClaim>& job) {
  state_->check_version(map, version, quota());
  const fs::path target = packages_.path_of(version.digest);
  const bool is_first = !is_stored(version.digest);
  if (blobs_)
    blobs_->confirm(package, state_->files());
  else
    incoming.publish(package, target);
  try {
    return commit(map, version, job);
  } catch (const StoreRefusal&) {
    // A part of a drive has taken the last bytes meanwhile, or the job was cancelled.
    if (is_first) remove_files(version.digest);
    throw;
  }
}

KnownFiles PackageStore::files_of_versions(std::string_view map, const std::string& but) const {
  std::set<std::string> digests;
  for (const StoredMap& each : state_->maps()) {
    if (each.name != map) continue;
    for (const StoredVersion& version : state_->versions(map)) digests.insert(version.digest);
  }
  digests.erase(but);
  KnownFiles known;
  for (const std::string& digest : digests) add_files_of(packages_.path_of(digest), known);
  return known;
}

FindFile PackageStore::files_to_take(std::string_view map,
                                     const PackageFolder::Incoming* taken) const {
  if (!blobs_)
    return [known = files_of_versions(map, {})](
               const maps::MapManifest::File& file) -> std::optional<fs::path> {
      const auto found = known.find(file.sha256);
      return found == known.end() ? std::nullopt : std::optional(found->second);
    };
  // Those of this map alone: an upload must not show which files others have.
  const auto own = std::make_shared<std::optional<std::set<std::string>>>();
  return [this, own, map = std::string(map),
          taken](const maps::MapManifest::File& file) -> std::optional<fs::path> {
    if (!*own) {
      own->emplace();
      for (const StoredMap& each : state_->maps())
        if (each.name == map)
          for (const StoredVersion& version : state_->versions(map))
            for (const auto& [path, listed] : blobs_->manifest(version.digest).files)
              (*own)->insert(listed.sha256);
    }
    if (!(*own)->contains(file.sha256)) return std::nullopt;
    const fs::path to = taken->path() / file.sha256;
    if (!is_there(to)) blobs_->bring_file(file, to);
    return to;
  };
}

/// Of packages that came before the store knew of files.
void PackageStore::note_files() {
  for (const std::string& digest : state_->packages_without_files()) {
    try {
      state_->note_files(digest, version_of(digest, {}).files);
    } catch (const maps::InputError&) {
      // A damaged package counts when it is mended.
    }
  }
}

/// Whether its package lies there whole, by itself or as what it was migrated to, which the version
/// then has instead.
bool PackageStore::find_whole(std::string_view map, StoredVersion& version) const {
  if (is_whole(version.digest)) return true;
  const std::string current = state_->current_digest(version.digest);
  if (current == version.digest) return false;
  if (is_whole(current)) {
    version = version_of(current, version.name);
    return true;
  }
  const auto known = state_->find_version(map, version.name);
  if (!known || known->digest != current) return false;
  throw maps::InputError(packages_.path_of(current).string(),
                         "a damaged package, to which this one was migrated",
                         "a whole one: restore it from a backup, or add this one by another name");
}

StoredVersion PackageStore::replace(const std::string& former, PackageFolder::Incoming& incoming,
                                    const fs::path& package) {
  check_readable(package);
  StoredVersion converted = version_in(package, {});
  const StoreLock lock = locked();
  if (!state_->uses(former)) return converted;
  if (!packages_.has_whole(converted.digest))
    incoming.publish(package, packages_.path_of(converted.digest));
  packages_.sync();
  state_->replace_package(former, converted);
  clear_condemned_if_possible();
  return converted;
}

/// Under the lock, with the package in its place.
PackageStore::Added PackageStore::commit(std::string_view map, const StoredVersion& version,
                                         const std::optional<JobClaim>& job) {
  if (!blobs_) packages_.sync();
  const bool is_new = state_->add_version(map, version, quota(), job);
  state_->signatures().add(map, version.digest, version.signatures);
  return {state_->version(map, version.name), is_new};
}

StoredMap PackageStore::activate(std::string_view map, std::string_view version,
                                 std::optional<std::int64_t> revision) {
  (void)open(map, version);
  require_signed(map, version);
  return state_->activate(map, version, revision);
}

StoredMap PackageStore::roll_back(std::string_view map, std::optional<std::int64_t> revision) {
  const StoredMap seen = state_->map(map);
  if (seen.previous && revision.value_or(seen.revision) == seen.revision) {
    (void)open(map, *seen.previous);
    require_signed(map, *seen.previous);
  }
  // What was checked is what must become active, so the map may not have changed meanwhile.
  return state_->roll_back(map, revision ? revision : seen.revision);
}

bool PackageStore::create_map(std::string_view map) { return state_->create_map(map, now_ns()); }

bool PackageStore::remove(std::string_view map, std::string_view version) {
  const StoreLock lock = locked();
  const std::string digest = state_->version(map, version).digest;
  state_->remove_version(map, version);
  clear_condemned_if_possible();
  if (!blobs_) return !packages_.has(digest);
  return !state_->uses(digest) && !std::ranges::count(state_->condemned(), digest);
}

void PackageStore::remove_map(std::string_view map, WhenActive when_active) {
  const StoreLock lock = locked();
  state_->remove_map(map, when_active);
  clear_condemned_if_possible();
}

/// Whether it is active, the one to roll back to, or rolled out.
bool PackageStore::is_in_use(const StoredMap& map, const std::string& version) const {
  if (version == map.active || version == map.previous) return true;
  const std::vector<Rollout> rollouts = state_->rollouts().list();
  return std::ranges::any_of(rollouts, [&](const Rollout& each) {
    return each.map == map.name && each.version == version;
  });
}

std::vector<std::string> PackageStore::keep_newest(std::string_view map, std::size_t count) {
  const StoreLock lock = locked();
  const StoredMap now = state_->map(map);
  std::vector<std::string> others;
  for (const StoredVersion& version : state_->versions(map))
    if (!is_in_use(now, version.name)) others.push_back(version.name);
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

void PackageStore::drop_derived(std::int64_t not_since_ns) {
  const StoreLock lock = locked();
  std::set<std::string> used, others;
  for (const StoredMap& map : state_->maps())
    for (const StoredVersion& version : state_->versions(map.name))
      (is_in_use(map, version.name) ? used : others).insert(version.digest);
  const DurableFiles files(*calls_);
  for (const std::string& digest : others) {
    if (used.contains(digest)) continue;
    for (const char* name : kDerivedFolders) {
      const fs::path folder = packages_.path_of(digest) / name;
      if (is_there(folder) && last_use_ns(folder) < not_since_ns) files.remove_tree(folder);
    }
  }
}

/// The rows are removed, which must not look like a failure; the rest stays noted.
void PackageStore::clear_condemned_if_possible() {
  try {
    state_->even_when_full([&] { clear_condemned(); });
  } catch (const maps::StorageError&) {
    // The next `clear_unused` or open tries again.
  }
}

void PackageStore::clear_condemned() {
  for (const std::string& digest : state_->condemned()) {
    remove_files(digest);
    if (!blobs_) packages_.sync();
    state_->forget_condemned(digest);
  }
}

/// Under the lock: of a package that no version names.
void PackageStore::remove_files(const std::string& digest) {
  const FileBytes others = blobs_ ? state_->files() : FileBytes();
  state_->require_current();
  if (blobs_)
    blobs_->remove(digest, others);
  else
    packages_.remove(digest);
}

StoreLock PackageStore::locked() const {
  if (!read_only_because().empty())
    throw maps::StorageError(folder_.string(), "open for reading only: " + read_only_because());
  FolderLock folder(folder_ / kLockName);
  return {std::move(folder), state_->lock_of_packages()};
}

}  // namespace stillmap::server
