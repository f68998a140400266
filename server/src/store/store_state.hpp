#pragma once

#include "store/audit_log.hpp"
#include "store/disk_calls.hpp"
#include "store/drive_table.hpp"
#include "store/edits_table.hpp"
#include "store/job_table.hpp"
#include "store/key_table.hpp"
#include "store/rollout_table.hpp"
#include "store/seal_key_table.hpp"
#include "store/set_table.hpp"
#include "store/signature_table.hpp"
#include "store/store_quota.hpp"
#include "store/store_refusal.hpp"

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::server {

class PostgresAddress;

/// Bytes of files by their SHA-256, hex.
using FileBytes = std::map<std::string, std::uint64_t>;

/// A published version of a map.
struct StoredVersion {
  /// As the publisher named it; like a map's name.
  std::string name{};
  /// SHA-256 of its package's manifest, hex.
  std::string digest{};
  /// Of its files, manifest included.
  std::uint64_t bytes = 0;
  std::int64_t created_ns = 0;
  /// By which its package went before it was migrated to a newer schema; sorted.
  std::vector<std::string> former_digests{};
  /// Of its package, manifest included, as it comes into a store; without any, what it shares with
  /// others is not known. Empty in what a store tells.
  FileBytes files{};
  /// That come with it; empty in what a store tells.
  std::vector<MapSignature> signatures{};
  auto operator<=>(const StoredVersion&) const = default;
};

/// A map of the store.
struct StoredMap {
  std::string name{};
  std::optional<std::string> active{};
  /// Active before; what rolling back goes to.
  std::optional<std::string> previous{};
  /// Grows with every change of the active pointer, never goes back.
  std::int64_t revision = 0;
  std::int64_t created_ns = 0;
  auto operator<=>(const StoredMap&) const = default;
};

/// Digests of packages by map and version.
using PackageDigests = std::map<std::pair<std::string, std::string>, std::string>;

/// What removing a map does when one of its versions is active.
enum class WhenActive : std::uint8_t { kRefuse, kRemove };

/// Names, versions and active pointers of a store, and its keys, jobs, drives, saved corrections,
/// roll-outs, sets and audit log, in one database, SQLite's or PostgreSQL's, that outlives a power
/// cut: what returned is kept. Knows nothing of packages on the disk. Safe from several threads,
/// and several processes may have it open. Throws StorageError when the disk fails; a change has
/// then not happened, or (a failed sync) may show after the next open.
class StoreState {
 public:
  /// Opens or makes it, and brings an older schema up to date. When the disk does not allow that,
  /// but the file can be read, it is read into memory: then every change throws StorageError.
  /// @param calls  outlives this.
  /// @throws InputError for a database that is not ours or has a newer schema.
  explicit StoreState(const std::filesystem::path& file, DiskCalls& calls = DiskCalls::real());
  /// Where not even a lock can be taken: reads the file into memory at once.
  struct ReadOnly {
    std::string because;
  };
  StoreState(const std::filesystem::path& file, const ReadOnly& why);
  /// In PostgreSQL, shared by servers on several machines; made there when it is not there yet.
  /// @throws StateAway when it cannot be reached.
  explicit StoreState(const PostgresAddress& address);
  ~StoreState();
  StoreState(const StoreState&) = delete;
  StoreState& operator=(const StoreState&) = delete;

  /// As `StoreDatabase::lock_of_packages`.
  [[nodiscard]] std::shared_ptr<void> lock_of_packages() const;
  /// Returns when all that was read is on the synchronous standby, too, and no other server has
  /// got the lock of packages from this one. Before what cannot be undone, such as the removal of a
  /// package. @throws StateAway, StorageError.
  void require_current() const;
  /// Whether servers with folders of their own may share it.
  [[nodiscard]] bool is_shared() const;
  /// As `StoreDatabase::told_mark`: while it stays the same, all that can be read stays the same.
  [[nodiscard]] std::optional<std::int64_t> told_mark() const;
  /// Why it is in memory only; empty when it is not.
  [[nodiscard]] const std::string& read_only_because() const;

  /// Sorted by name.
  [[nodiscard]] std::vector<StoredMap> maps() const;
  /// @throws StoreRefusal kUnknownMap.
  [[nodiscard]] StoredMap map(std::string_view name) const;
  /// Oldest first. @throws StoreRefusal kUnknownMap.
  [[nodiscard]] std::vector<StoredVersion> versions(std::string_view map) const;
  /// @throws StoreRefusal kUnknownMap, kUnknownVersion.
  [[nodiscard]] StoredVersion version(std::string_view map, std::string_view version) const;
  /// The same, or nothing.
  [[nodiscard]] std::optional<StoredVersion> find_version(std::string_view map,
                                                          std::string_view version) const;
  /// The package of a removed version of that name, by digest: the name is good for no other.
  [[nodiscard]] std::optional<std::string> retired(std::string_view map,
                                                   std::string_view version) const;
  /// Digests of the packages of all versions, by map and version.
  [[nodiscard]] PackageDigests digests() const;
  /// Whether any version of any map holds this package.
  [[nodiscard]] bool uses(std::string_view digest) const;
  /// The digest by which a package goes now: another one after it was migrated.
  [[nodiscard]] std::string current_digest(std::string_view digest) const;
  /// The digest by which it went at first; of several the lowest.
  [[nodiscard]] std::string first_digest(const std::string& digest) const;

  /// Makes a map without versions. @return false when it is there already.
  /// @throws std::invalid_argument for a name that is not `is_valid_map_name`.
  bool create_map(std::string_view name, std::int64_t now_ns);
  /// With its versions and saved corrections; packages that no version holds any more are noted as
  /// `condemned`.
  /// @throws StoreRefusal kUnknownMap; kActive; kInUse while it has a drive, an upload under way or
  /// an unfinished job, or while a set names it.
  void remove_map(std::string_view name, WhenActive when_active = WhenActive::kRefuse);
  /// Bytes of packages and drives; a file that several versions of a map share counts once.
  /// @throws StoreRefusal kUnknownMap.
  [[nodiscard]] std::uint64_t bytes_of_map(std::string_view map) const;
  [[nodiscard]] std::uint64_t bytes() const;
  /// Whether so many bytes more may come. A map that is not there yet has none.
  /// @param waiting  counts as if it were there. @throws StoreRefusal kOverQuota.
  void check_quota(const StoreQuota& quota, std::string_view map, std::uint64_t more_bytes,
                   const WaitingBytes& waiting = {}) const;

  /// Whether `add_version` would take it now. @throws as it does.
  void check_version(std::string_view map, const StoredVersion& version,
                     const StoreQuota& quota) const;
  /// Makes the map with it when it is new. The name of a removed version is good for the same
  /// package only. A package is the same before and after its migration.
  /// @param job  made it: from then on it cannot be cancelled.
  /// @return false when the same is there already. @throws StoreRefusal kOtherDigest, kOverQuota,
  /// kNotProcessing when the job is cancelled.
  bool add_version(std::string_view map, const StoredVersion& version, const StoreQuota& quota = {},
                   const std::optional<JobClaim>& job = {});
  /// What is active already stays so, with its revision. A roll-out of the map ends.
  /// @param revision  only when the map is still at it. @param now_ns  the clock's unless it is
  /// said. @return the map afterwards.
  /// @throws StoreRefusal kUnknownMap, kUnknownVersion, kOtherRevision.
  StoredMap activate(std::string_view map, std::string_view version,
                     std::optional<std::int64_t> revision = {},
                     std::optional<std::int64_t> now_ns = {});
  /// Swaps the active version with the one before. A roll-out of the map ends. @throws StoreRefusal
  /// kUnknownMap, kNoPrevious, kOtherRevision.
  StoredMap roll_back(std::string_view map, std::optional<std::int64_t> revision = {},
                      std::optional<std::int64_t> now_ns = {});
  /// The version that was active at a time. It may have been removed since.
  /// @throws StoreRefusal kUnknownMap, kUnknownVersion when none was.
  [[nodiscard]] std::string active_at(std::string_view map, std::int64_t time_ns) const;
  /// A package that no version holds any more is noted as `condemned`.
  /// @throws StoreRefusal kUnknownMap, kUnknownVersion; kActive for the active version and for one
  /// that is rolled out.
  void remove_version(std::string_view map, std::string_view version);

  /// For what removes or revokes, which all of the tables do by themselves: on a full disk the room
  /// that `keep_ballast` holds is given up, and it is tried once more.
  /// @param change  has changed nothing when it throws DiskFull.
  void even_when_full(const std::function<void()>& change);
  /// Makes a file of some MiB beside the database that holds room for that, unless it is there or
  /// there is no room for it.
  void keep_ballast() const;
  /// Why no change is possible; empty when changes are.
  [[nodiscard]] std::string not_writable_because() const;
  /// Since a state in PostgreSQL answered last; nothing for one in the folder.
  [[nodiscard]] std::chrono::duration<double> silence() const;

  /// Gives all versions of a package the one that it was migrated to, and keeps the former digest
  /// as a name of it. The former package is noted as `condemned`.
  void replace_package(std::string_view former, const StoredVersion& converted);

  /// Packages of which it is not known which files they have: those of a store of an older schema.
  [[nodiscard]] std::vector<std::string> packages_without_files() const;
  void note_files(std::string_view digest, const FileBytes& files);
  /// Of all packages that versions name.
  [[nodiscard]] FileBytes files() const;

  /// Packages whose last version was removed, and which may lie on the disk still.
  [[nodiscard]] std::vector<std::string> condemned() const;
  /// Its package is gone from the disk.
  void forget_condemned(std::string_view digest);
  [[nodiscard]] KeyTable& keys();
  [[nodiscard]] JobTable& jobs();
  [[nodiscard]] DriveTable& drives();
  [[nodiscard]] EditsTable& edits();
  [[nodiscard]] SignatureTable& signatures();
  [[nodiscard]] RolloutTable& rollouts();
  [[nodiscard]] SealKeyTable& seal_keys();
  [[nodiscard]] SetTable& sets();
  [[nodiscard]] AuditLog& audit();
  [[nodiscard]] const KeyTable& keys() const;
  [[nodiscard]] const JobTable& jobs() const;
  [[nodiscard]] const DriveTable& drives() const;
  [[nodiscard]] const EditsTable& edits() const;
  [[nodiscard]] const SignatureTable& signatures() const;
  [[nodiscard]] const RolloutTable& rollouts() const;
  [[nodiscard]] const SetTable& sets() const;
  [[nodiscard]] const AuditLog& audit() const;

  /// Writes it, as of one instant, into one new file, synced. Without drives, whose bytes are
  /// elsewhere; jobs that have not finished, which may need them, are failed in it.
  void write_backup(const std::filesystem::path& file, std::int64_t now_ns,
                    DiskCalls& calls = DiskCalls::real()) const;

  /// What SQLite finds wrong with the database; empty when sound. PostgreSQL checks its own.
  [[nodiscard]] std::vector<std::string> problems() const;

 private:
  struct Inner;
  std::unique_ptr<Inner> inner_;
};

}  // namespace stillmap::server
