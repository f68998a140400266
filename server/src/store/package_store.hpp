#pragma once

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/package_delta.hpp>
#include "store/archive.hpp"
#include "store/folder_lock.hpp"
#include "store/incoming_package.hpp"
#include "store/package_archive.hpp"
#include "store/package_blobs.hpp"
#include "store/package_folder.hpp"
#include "store/shared_files.hpp"
#include "store/store_state.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {
class StorageError;
}

namespace stillmap::server {

/// Held while packages come and go: in the folder, and between servers that share a state. Between
/// servers it is lost with a connection to PostgreSQL, in silence. Then changes of rows are refused
/// once another server has had it, and so is the next removal from S3. Only the files of the one
/// package whose removal is under way at that moment still go.
struct StoreLock {
  FolderLock folder;
  std::shared_ptr<void> state;
};

/// Published map versions: immutable packages on the disk and the state that names them, kept in
/// step through kills, full disks and power cuts (server/store.md says how). A change that returned
/// is kept; one that threw StorageError may or may not have happened, and may be asked for again.
/// Safe from several threads, and several processes may have it open.
class PackageStore {
 public:
  /// Opens the store in this folder, which must exist, or makes one there; finishes removals and
  /// clears what killed writers left. Where the disk is read-only, full or failing, but can be
  /// read, it is open for reading only: maps are served as they stood, and every change throws
  /// StorageError.
  /// @param calls  outlives this.
  /// @param blobs  where packages are; nothing: in the store's folder. Who opens a store with
  /// others than those it was made with loses its packages: see `open_store`.
  /// @throws InputError when there are packages but no state that names them, or as `StoreState`.
  explicit PackageStore(const std::filesystem::path& folder, DiskCalls& calls = DiskCalls::real(),
                        std::unique_ptr<PackageBlobs> blobs = {});
  ~PackageStore();
  PackageStore(const PackageStore&) = delete;
  PackageStore& operator=(const PackageStore&) = delete;

  /// Makes an empty folder for a store, in a folder that exists. @return false when it is there.
  static bool make_folder(const std::filesystem::path& folder,
                          DiskCalls& calls = DiskCalls::real());
  /// Makes a folder a store whose state is in PostgreSQL, where other stores share it; nothing
  /// changes when it is that already. @throws InputError when it has a state of its own, or one at
  /// another address; StorageError.
  static void attach(const std::filesystem::path& folder, const PostgresAddress& address,
                     DiskCalls& calls = DiskCalls::real());
  /// Whether a folder holds a store already.
  [[nodiscard]] static bool is_store(const std::filesystem::path& folder);

  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  /// Names, versions and active pointers.
  [[nodiscard]] const StoreState& state() const { return *state_; }
  [[nodiscard]] KeyTable& keys() { return state_->keys(); }
  [[nodiscard]] JobTable& jobs() { return state_->jobs(); }
  [[nodiscard]] DriveTable& drives() { return state_->drives(); }
  [[nodiscard]] EditsTable& edits() { return state_->edits(); }
  [[nodiscard]] RolloutTable& rollouts() { return state_->rollouts(); }
  [[nodiscard]] SealKeyTable& seal_keys() { return state_->seal_keys(); }
  [[nodiscard]] SetTable& sets() { return state_->sets(); }
  [[nodiscard]] AuditLog& audit() { return state_->audit(); }
  [[nodiscard]] SignatureTable& signatures() { return state_->signatures(); }
  /// Why what is not needed any more still lies there; empty when it was cleared at opening.
  [[nodiscard]] const std::string& not_cleared_because() const { return not_cleared_because_; }
  /// Why the store is open for reading only; empty when it is not.
  [[nodiscard]] const std::string& read_only_because() const { return state_->read_only_because(); }
  /// For versions and drives to come; what is there already stays.
  void set_quota(const StoreQuota& quota);
  [[nodiscard]] StoreQuota quota() const;
  /// From then on a version is taken and made active only when one of these keys has signed it;
  /// nothing: all are. What a job makes is taken without, and waits for a signature.
  void set_trust(const std::optional<PublicKeys>& keys);
  /// @throws StoreRefusal kNotSigned; kUnknownMap and kUnknownVersion where keys are set.
  void require_signed(std::string_view map, std::string_view version) const;
  /// Of these versions those that it would refuse, and why.
  [[nodiscard]] std::map<std::pair<std::string, std::string>, std::string> not_signed(
      const PackageDigests& versions) const;
  /// Whether so many bytes may come, of a drive or of what becomes a package.
  /// @param waiting  counts as if it were there. @throws StoreRefusal kOverQuota, kDiskReserve.
  void check_quota(std::string_view map, std::uint64_t more_bytes,
                   const WaitingBytes& waiting = {}) const;
  /// Whether the disk keeps its reserve when so many bytes come into this folder.
  /// @throws StoreRefusal kDiskReserve.
  void check_disk_reserve(const std::filesystem::path& folder, std::uint64_t more_bytes) const;
  void check_disk_reserve(std::uint64_t more_bytes) const {
    check_disk_reserve(folder_, more_bytes);
  }
  /// The same bytes. Reading them throws StoreRefusal kDiskReserve once the disk has less than its
  /// reserve free: how much an archive takes is only known while it is unpacked.
  [[nodiscard]] ByteSource leaving_reserve(const ByteSource& source) const;
  /// As `StoreState::even_when_full`.
  void even_when_full(const std::function<void()>& change) { state_->even_when_full(change); }
  /// A version's package. One that is open stays usable when the version is removed, but what
  /// it reads at need (histories of the whole drive, objects) is gone then.
  /// @throws StoreRefusal kUnknownMap, kUnknownVersion; InputError when it is broken.
  [[nodiscard]] std::shared_ptr<const maps::MapPackage> open(std::string_view map,
                                                             std::string_view version) const;

  /// Its manifest, without the rest of the package. Waits for S3 a few seconds only.
  /// @throws as `open`.
  [[nodiscard]] maps::MapManifest manifest(std::string_view map, std::string_view version) const;
  /// A package on the local disk, brought there if it is elsewhere.
  [[nodiscard]] PackageBlobs::Local local(const std::string& digest) const;
  /// The same of one that need not be fetched; nothing when it must be.
  [[nodiscard]] std::optional<PackageBlobs::Local> find_local(const std::string& digest) const;

  /// Tells one copy of a package from another: changes when a damaged one is replaced. 0 when there
  /// is none.
  [[nodiscard]] std::uint64_t copy_of(const std::string& digest) const;

  struct Added {
    StoredVersion version;
    /// False when it was there already, with the same digest.
    bool is_new = false;
  };
  /// The job that has made a package.
  struct Maker {
    JobClaim job;
    /// Asked again and again until it is published; then it is given up.
    std::function<bool()> is_unwanted;
  };
  /// Copies a package into the store, checks it (schema, presence, sizes, checksums, objects,
  /// trajectories) and publishes it under this name. The given folder is only read. A stored copy
  /// that is whole is kept, one that is damaged is replaced in one step, for all its versions. A
  /// package that was migrated since is there already, as what it has become.
  /// @throws std::invalid_argument for a name that is not `is_valid_map_name`; InputError naming
  /// what is wrong with the package; StoreRefusal kOtherDigest; kOverQuota, before bytes are
  /// copied; kNotProcessing for a maker that is cancelled or unwanted; kNotSigned. Nothing is left
  /// then. Signatures beside the package's manifest come with it.
  /// @param maker  may be cancelled until its version is there, and no longer.
  Added add(std::string_view map, std::string_view version, const std::filesystem::path& package,
            const std::optional<Maker>& maker = {});
  /// As `add`, of a package that comes as a tar, by itself or in one folder: unpacked straight into
  /// the store, hashed while it is written. Files that the manifest does not list are dropped;
  /// those that it lists and that versions of this map have may be left out of the tar.
  /// @param sha256  of the archive as it comes, lower-case hex, where that is known.
  /// @throws also InputError as `extract_archive`, and for another SHA-256. Nothing is left then.
  Added add_archive(std::string_view map, std::string_view version, const IncomingArchive& archive,
                    const std::optional<std::string>& sha256 = {});
  /// A version's package as a tar. @param without  the digest of another version of the map, whose
  /// files are left out; empty for none. @throws as `open`; StoreRefusal kUnknownVersion.
  [[nodiscard]] std::unique_ptr<PackageArchive> archive(std::string_view map,
                                                        std::string_view version,
                                                        std::string_view without = {}) const;
  /// What of a version is missing where another version of the map lies already.
  /// @param from  its digest. @throws as `archive`.
  [[nodiscard]] maps::PackageDelta delta(std::string_view map, std::string_view version,
                                         std::string_view from) const;
  /// Compares all files of such a package with their checksums, the first time and when one of them
  /// was written or replaced since. Some half a millisecond a megabyte, one package at a time.
  /// @return the path of the first that is damaged; empty when the package is whole.
  [[nodiscard]] std::string damage_of(const PackageArchive& archive) const;
  /// As `StoreState::activate`, but a package that cannot be opened never becomes active.
  /// @throws also InputError, StoreRefusal kNotSigned.
  StoredMap activate(std::string_view map, std::string_view version,
                     std::optional<std::int64_t> revision = {});
  /// As `StoreState::roll_back`, with the same check.
  StoredMap roll_back(std::string_view map, std::optional<std::int64_t> revision = {});
  /// As `StoreState::remove_version`.
  /// @return whether its package is gone from the disk: not while another version holds it, and not
  /// when the disk fails at that; then the next `clear_unused` or open tries again.
  bool remove(std::string_view map, std::string_view version);

  /// Makes a map without versions. @return false when it is there already.
  /// @throws std::invalid_argument for a name that is not `is_valid_map_name`.
  bool create_map(std::string_view map);
  /// With all its versions. @throws as `StoreState::remove_map`.
  void remove_map(std::string_view map, WhenActive when_active = WhenActive::kRefuse);
  /// Removes all versions but the active one, the one to roll back to, and the newest `count` of
  /// the others. @return those removed, oldest first. @throws StoreRefusal kUnknownMap.
  std::vector<std::string> keep_newest(std::string_view map, std::size_t count);

  /// Removes what was made of packages (indexes, levels of detail) of which no version is active,
  /// the one to roll back to or rolled out, and that nobody has read since a time.
  void drop_derived(std::int64_t not_since_ns);

  // The rest is for backups (store_backup.hpp), checks and cleaning (store_upkeep.hpp).

  /// Held while packages come and go. @throws StorageError when it is open for reading only.
  [[nodiscard]] StoreLock locked() const;
  [[nodiscard]] const PackageFolder& packages() const { return packages_; }
  /// Null when the packages are in the store's folder.
  [[nodiscard]] PackageBlobs* blobs() const { return blobs_.get(); }
  /// What is wrong with a package; empty when it is whole. Reads all of it.
  /// @param known  files that were read already, where the packages are elsewhere.
  [[nodiscard]] std::string damage_of(const std::string& digest,
                                      PackageBlobs::Verified& known) const;
  [[nodiscard]] DiskCalls& calls() const { return *calls_; }
  /// Puts a package in place of the one that it was converted from, for all versions of that one.
  /// Nothing happens when no version holds it any more. @return digest and bytes of the new one.
  /// @param package  in `incoming`, synced. @throws InputError when it cannot be read,
  /// StorageError.
  StoredVersion replace(const std::string& former, PackageFolder::Incoming& incoming,
                        const std::filesystem::path& package);
  /// Under the lock: removes packages whose versions are removed and that are still there.
  void clear_condemned();

 private:
  void refuse_lost_state() const;
  void open_read_only(const maps::StorageError& reason);
  [[nodiscard]] bool find_whole(std::string_view map, StoredVersion& version) const;
  void note_files();
  /// Where its files must be with a row that names it. Under the lock.
  [[nodiscard]] bool is_stored(const std::string& digest) const;
  [[nodiscard]] bool is_whole(const std::string& digest) const;
  [[nodiscard]] StoredVersion version_of(const std::string& digest, std::string_view name) const;
  /// Before the lock is taken: what takes time.
  void send(const std::filesystem::path& package, const std::string& digest) const;
  /// For what is being written, under the lock.
  [[nodiscard]] std::unique_ptr<PackageFolder::Incoming> begin_incoming(
      const DurableFiles& files) const;
  [[nodiscard]] bool is_in_use(const StoredMap& map, const std::string& version) const;
  [[nodiscard]] std::optional<PublicKeys> trust() const;
  /// @param version  with the signatures that come with it, or without. @throws StoreRefusal.
  void require_trust(std::string_view map, const StoredVersion& version) const;
  Added commit(std::string_view map, const StoredVersion& version,
               const std::optional<JobClaim>& job = {});
  Added publish(PackageFolder::Incoming& incoming, const std::filesystem::path& package,
                std::string_view map, const StoredVersion& version,
                const std::optional<JobClaim>& job = {});
  /// @throws StoreRefusal when the map has no version of this digest.
  void require_version_of(std::string_view map, std::string_view digest) const;
  /// Versions of a map have most of their tiles in common. @param but  a digest.
  [[nodiscard]] KnownFiles files_of_versions(std::string_view map, const std::string& but) const;
  /// Files that an upload may leave out. @param taken  where they are put that come from elsewhere.
  [[nodiscard]] FindFile files_to_take(std::string_view map,
                                       const PackageFolder::Incoming* taken) const;
  void clear_condemned_if_possible();
  void remove_files(const std::string& digest);

  std::filesystem::path folder_;
  DiskCalls* calls_;
  std::unique_ptr<PackageBlobs> blobs_;
  PackageFolder packages_;
  std::unique_ptr<StoreState> state_;
  std::string not_cleared_because_;
  /// Of a package that was compared with its checksums.
  struct Compared {
    std::string files_state, first_damaged;
  };
  /// One package is compared at a time. Before `compared_mutex_`.
  mutable std::mutex comparing_mutex_;
  mutable std::mutex compared_mutex_;
  mutable std::map<std::string, Compared, std::less<>> compared_;
  mutable std::mutex quota_mutex_;
  StoreQuota quota_;
  mutable std::mutex trust_mutex_;
  std::optional<PublicKeys> trust_;
};

}  // namespace stillmap::server
