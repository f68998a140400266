#include "store/store_state.hpp"

#include "store/ids_and_times.hpp"
#include "store/map_name.hpp"

#include <set>
#include <stdexcept>
#include <utility>

#include "store/map_rows.hpp"
#include "store/postgres_database.hpp"
#include "store/store_database.hpp"

namespace stillmap::server {
namespace {

using Reason = StoreRefusal::Reason;
using Reading = StoreDatabase::Reading;
using Writing = StoreDatabase::Writing;
using WritingOfPackages = StoreDatabase::WritingOfPackages;

void check_revision(const StoredMap& map, std::optional<std::int64_t> revision) {
  if (!revision || *revision == map.revision) return;
  throw StoreRefusal(Reason::kOtherRevision, "map " + in_quotes(map.name) + " is at revision " +
                                                 std::to_string(map.revision) + ", not " +
                                                 std::to_string(*revision));
}

StoredMap point_to(Database& database, StoredMap map, const std::string& version,
                   std::optional<std::int64_t> now_ns) {
  map.previous = std::exchange(map.active, version);
  ++map.revision;
  Statement(database, "UPDATE maps SET active = ?, previous = ?, revision = ? WHERE name = ?")
      .bind(map.active)
      .bind(map.previous)
      .bind(map.revision)
      .bind(map.name)
      .step();
  Statement(database,
            "INSERT INTO activations (map, revision, version, time_ns) VALUES (?, ?, ?, ?)")
      .bind(map.name)
      .bind(map.revision)
      .bind(version)
      .bind(now_ns ? *now_ns : unix_ns())
      .step();
  // Completed, or compared with what is not active any more.
  Statement(database, "DELETE FROM rollouts WHERE map = ?").bind(map.name).step();
  return map;
}

bool insert_map(Database& database, std::string_view name, std::int64_t now_ns) {
  // A removed map of this name is told from this one by its revisions.
  Statement(database,
            "INSERT INTO maps (name, created_ns, revision) VALUES (?, ?,"
            " coalesce((SELECT revision + 1 FROM retired_maps WHERE name = ?), 0))"
            " ON CONFLICT DO NOTHING")
      .bind(name)
      .bind(now_ns)
      .bind(name)
      .step();
  return database.changes() > 0;
}

void refuse_if_in_use(Database& database, std::string_view map) {
  Statement drive(database,
                  "SELECT version FROM drives WHERE map = ? AND (version IS NULL OR status ="
                  " 'open')");
  if (drive.bind(map).step())
    throw StoreRefusal(Reason::kInUse,
                       "map " + in_quotes(map) +
                           (drive.optional_text(0) ? " has an upload under way" : " has drives"));
  Statement job(database,
                "SELECT id FROM jobs WHERE map = ? AND status IN ('enqueued', 'processing')");
  if (job.bind(map).step())
    throw StoreRefusal(Reason::kInUse, "job " + job.text(0) + " is for map " + in_quotes(map));
  Statement set(database, "SELECT name FROM map_sets WHERE map = ?");
  if (set.bind(map).step())
    throw StoreRefusal(Reason::kInUse, "set " + in_quotes(set.text(0)) + " names map " +
                                           in_quotes(map) + ": change or remove the set first");
}

void refuse_if_rolled_out(Database& database, std::string_view map, std::string_view version) {
  Statement row(database, "SELECT 1 FROM rollouts WHERE map = ? AND version = ?");
  if (!row.bind(map).bind(version).step()) return;
  throw StoreRefusal(Reason::kActive, "version " + in_quotes(version) + " of map " +
                                          in_quotes(map) +
                                          " is rolled out: end the roll-out first");
}

std::optional<std::string> retired_digest(Database& database, std::string_view map,
                                          std::string_view version) {
  Statement row(database, "SELECT digest FROM retired WHERE map = ? AND version = ?");
  if (!row.bind(map).bind(version).step()) return std::nullopt;
  return row.text(0);
}

bool is_same_package(Database& database, std::string_view one, std::string_view other) {
  return current_digest(database, one) == current_digest(database, other);
}

/// Whoever has kept an answer about a version keeps it for ever, so its name means one thing for
/// ever.
void refuse_retired(Database& database, std::string_view map, const StoredVersion& version) {
  const std::optional<std::string> digest = retired_digest(database, map, version.name);
  if (!digest || is_same_package(database, *digest, version.digest)) return;
  throw StoreRefusal(Reason::kOtherDigest, "version " + in_quotes(version.name) + " of map " +
                                               in_quotes(map) +
                                               " was removed and held another package (" + *digest +
                                               "): choose another name");
}

/// @return whether the same is there already.
bool refuse_version(Database& database, std::string_view map, const StoredVersion& version,
                    const StoreQuota& quota) {
  if (const auto known = find_version(database, map, version.name)) {
    if (is_same_package(database, known->digest, version.digest)) return true;
    throw StoreRefusal(Reason::kOtherDigest, "version " + in_quotes(version.name) + " of map " +
                                                 in_quotes(map) + " is " + known->digest);
  }
  refuse_retired(database, map, version);
  refuse_over_quota(database, quota, {.map = map, .version = &version});
  return false;
}

/// Beside the version itself: whoever cancels the job comes before both, or is refused.
void note_published(Database& database, const JobClaim& job, const std::string& version) {
  Statement(database,
            "UPDATE jobs SET result_version = ? WHERE id = ? AND attempts = ?"
            " AND status = 'processing' AND cancel_requested = 0")
      .bind(version)
      .bind(job.id)
      .bind(job.attempt)
      .step();
  if (database.changes() > 0) return;
  throw StoreRefusal(Reason::kNotProcessing,
                     "job " + std::to_string(job.id) +
                         " is cancelled, or done by another attempt: this one publishes nothing");
}

}  // namespace

struct StoreState::Inner {
  /// @param where  as for `StoreDatabase`.
  template <typename... Where>
  explicit Inner(Where&&... where) : database(std::forward<Where>(where)...) {}
  StoreDatabase database;
  KeyTable keys{database};
  JobTable jobs{database};
  DriveTable drives{database};
  EditsTable edits{database};
  SignatureTable signatures{database};
  RolloutTable rollouts{database};
  SealKeyTable seal_keys{database};
  SetTable sets{database};
  AuditLog audit{database};
};

StoreState::StoreState(const std::filesystem::path& file, DiskCalls& calls)
    : inner_(std::make_unique<Inner>(file, calls)) {}

StoreState::StoreState(const std::filesystem::path& file, const ReadOnly& why)
    : inner_(std::make_unique<Inner>(file, why.because)) {}

StoreState::StoreState(const PostgresAddress& address) : inner_(std::make_unique<Inner>(address)) {}

StoreState::~StoreState() = default;

std::shared_ptr<void> StoreState::lock_of_packages() const {
  return inner_->database.lock_of_packages();
}

void StoreState::require_current() const {
  if (!is_shared()) return;
  WritingOfPackages writing(inner_->database);
  writing.commit();
}

bool StoreState::is_shared() const { return !inner_->database.is_sqlite(); }

std::optional<std::int64_t> StoreState::told_mark() const { return inner_->database.told_mark(); }

KeyTable& StoreState::keys() { return inner_->keys; }
JobTable& StoreState::jobs() { return inner_->jobs; }
DriveTable& StoreState::drives() { return inner_->drives; }
EditsTable& StoreState::edits() { return inner_->edits; }
SignatureTable& StoreState::signatures() { return inner_->signatures; }
RolloutTable& StoreState::rollouts() { return inner_->rollouts; }
SealKeyTable& StoreState::seal_keys() { return inner_->seal_keys; }
SetTable& StoreState::sets() { return inner_->sets; }
AuditLog& StoreState::audit() { return inner_->audit; }
const KeyTable& StoreState::keys() const { return inner_->keys; }
const JobTable& StoreState::jobs() const { return inner_->jobs; }
const DriveTable& StoreState::drives() const { return inner_->drives; }
const EditsTable& StoreState::edits() const { return inner_->edits; }
const SignatureTable& StoreState::signatures() const { return inner_->signatures; }
const RolloutTable& StoreState::rollouts() const { return inner_->rollouts; }
const SetTable& StoreState::sets() const { return inner_->sets; }
const AuditLog& StoreState::audit() const { return inner_->audit; }

const std::string& StoreState::read_only_because() const {
  return inner_->database.read_only_because();
}

std::vector<StoredMap> StoreState::maps() const {
  const Reading reading(inner_->database);
  return all_maps(reading.database());
}

StoredMap StoreState::map(std::string_view name) const {
  const Reading reading(inner_->database);
  return known_map(reading.database(), name);
}

std::vector<StoredVersion> StoreState::versions(std::string_view map) const {
  const Reading reading(inner_->database);
  (void)known_map(reading.database(), map);
  return versions_of(reading.database(), map);
}

StoredVersion StoreState::version(std::string_view map, std::string_view version) const {
  const Reading reading(inner_->database);
  (void)known_map(reading.database(), map);
  return known_version(reading.database(), map, version);
}

std::optional<StoredVersion> StoreState::find_version(std::string_view map,
                                                      std::string_view version) const {
  const Reading reading(inner_->database);
  return server::find_version(reading.database(), map, version);
}

std::optional<std::string> StoreState::retired(std::string_view map,
                                               std::string_view version) const {
  const Reading reading(inner_->database);
  return retired_digest(reading.database(), map, version);
}

PackageDigests StoreState::digests() const {
  const Reading reading(inner_->database);
  Statement row(reading.database(), "SELECT map, name, digest FROM versions");
  PackageDigests digests;
  while (row.step()) digests.emplace(std::pair(row.text(0), row.text(1)), row.text(2));
  return digests;
}

bool StoreState::uses(std::string_view digest) const {
  const Reading reading(inner_->database);
  return is_used(reading.database(), digest);
}

std::string StoreState::current_digest(std::string_view digest) const {
  const Reading reading(inner_->database);
  return server::current_digest(reading.database(), digest);
}

std::string StoreState::first_digest(const std::string& digest) const {
  const Reading reading(inner_->database);
  Statement row(reading.database(), "SELECT min(former) FROM migrated WHERE digest = ?");
  row.bind(digest).step();
  return row.optional_text(0).value_or(digest);
}

std::uint64_t StoreState::bytes_of_map(std::string_view map) const {
  const Reading reading(inner_->database);
  (void)known_map(reading.database(), map);
  return bytes_of(reading.database(), std::string(map));
}

std::uint64_t StoreState::bytes() const {
  const Reading reading(inner_->database);
  return bytes_of(reading.database(), {});
}

void StoreState::check_quota(const StoreQuota& quota, std::string_view map,
                             std::uint64_t more_bytes, const WaitingBytes& waiting) const {
  const Reading reading(inner_->database);
  refuse_over_quota(reading.database(), quota,
                    {.map = map, .bytes = more_bytes, .waiting = waiting});
}

void StoreState::check_version(std::string_view map, const StoredVersion& version,
                               const StoreQuota& quota) const {
  const Reading reading(inner_->database);
  refuse_version(reading.database(), map, version, quota);
}

bool StoreState::create_map(std::string_view name, std::int64_t now_ns) {
  if (!is_valid_map_name(name))
    throw std::invalid_argument("map: " + in_quotes(name) + ", [a-z0-9][a-z0-9._-]{0,62} expected");
  Writing writing(inner_->database);
  const bool is_new = insert_map(writing.database(), name, now_ns);
  // Also without a change: what is there must be on the standby before this says so.
  writing.commit();
  return is_new;
}

void StoreState::remove_map(std::string_view name, WhenActive when_active) {
  inner_->database.even_when_full([&] {
    WritingOfPackages writing(inner_->database);
    Database& database = writing.database();
    const StoredMap map = known_map(database, name);
    if (map.active && when_active == WhenActive::kRefuse)
      throw StoreRefusal(Reason::kActive, "version " + in_quotes(*map.active) + " of map " +
                                              in_quotes(name) + " is active");
    refuse_if_in_use(database, name);
    std::set<std::string> digests;
    for (const StoredVersion& version : versions_of(database, name)) digests.insert(version.digest);
    constexpr const char* kRetireVersions =
        "INSERT INTO retired (map, version, digest) SELECT map, name, digest FROM versions"
        " WHERE map = ? ON CONFLICT DO NOTHING";
    constexpr const char* kRetireMap =
        "INSERT INTO retired_maps (name, revision) SELECT name, revision FROM maps WHERE name = ?"
        " ON CONFLICT (name) DO UPDATE SET revision = excluded.revision";
    for (const char* sql :
         {"UPDATE maps SET active = NULL, previous = NULL WHERE name = ?", kRetireVersions,
          kRetireMap, "DELETE FROM rollouts WHERE map = ?", "DELETE FROM versions WHERE map = ?",
          "DELETE FROM saved_edits WHERE map = ?", "DELETE FROM activations WHERE map = ?",
          "DELETE FROM signatures WHERE map = ?",
          "DELETE FROM drive_parts WHERE drive IN (SELECT id FROM drives WHERE map = ?)",
          "DELETE FROM drives WHERE map = ?", "DELETE FROM maps WHERE name = ?"})
      Statement(database, sql).bind(name).step();
    for (const std::string& digest : digests) condemn_unused(database, digest);
    writing.commit();
  });
}

bool StoreState::add_version(std::string_view map, const StoredVersion& version,
                             const StoreQuota& quota, const std::optional<JobClaim>& job) {
  WritingOfPackages writing(inner_->database);
  Database& database = writing.database();
  if (job) note_published(database, *job, version.name);
  if (refuse_version(database, map, version, quota)) {
    writing.commit();
    return false;
  }
  insert_map(database, map, version.created_ns);
  Statement(database,
            "INSERT INTO versions (map, name, digest, bytes, created_ns) VALUES (?, ?, ?, ?, ?)")
      .bind(map)
      .bind(version.name)
      .bind(version.digest)
      .bind(static_cast<std::int64_t>(version.bytes))
      .bind(version.created_ns)
      .step();
  Statement(database, "DELETE FROM condemned WHERE digest = ?").bind(version.digest).step();
  add_files(database, version);
  writing.commit();
  return true;
}

StoredMap StoreState::activate(std::string_view map, std::string_view version,
                               std::optional<std::int64_t> revision,
                               std::optional<std::int64_t> now_ns) {
  Writing writing(inner_->database);
  Database& database = writing.database();
  StoredMap now = known_map(database, map);
  check_revision(now, revision);
  (void)known_version(database, map, version);
  if (now.active != version) now = point_to(database, now, std::string(version), now_ns);
  writing.commit();
  return now;
}

StoredMap StoreState::roll_back(std::string_view map, std::optional<std::int64_t> revision,
                                std::optional<std::int64_t> now_ns) {
  Writing writing(inner_->database);
  Database& database = writing.database();
  const StoredMap now = known_map(database, map);
  check_revision(now, revision);
  if (!now.previous)
    throw StoreRefusal(Reason::kNoPrevious,
                       "map " + in_quotes(map) + " has no version before this");
  StoredMap then = point_to(database, now, *now.previous, now_ns);
  writing.commit();
  return then;
}

std::string StoreState::active_at(std::string_view map, std::int64_t time_ns) const {
  const Reading reading(inner_->database);
  (void)known_map(reading.database(), map);
  Statement row(reading.database(),
                "SELECT version FROM activations WHERE map = ? AND time_ns <= ?"
                " ORDER BY revision DESC LIMIT 1");
  if (!row.bind(map).bind(time_ns).step())
    throw StoreRefusal(Reason::kUnknownVersion, "map " + in_quotes(map) +
                                                    " had no active version at that time: ask for "
                                                    "a later one");
  return row.text(0);
}

void StoreState::remove_version(std::string_view map, std::string_view version) {
  inner_->database.even_when_full([&] {
    WritingOfPackages writing(inner_->database);
    Database& database = writing.database();
    const StoredMap now = known_map(database, map);
    const StoredVersion gone = known_version(database, map, version);
    if (now.active == version)
      throw StoreRefusal(Reason::kActive, "version " + in_quotes(version) + " of map " +
                                              in_quotes(map) + " is active");
    refuse_if_rolled_out(database, map, version);
    Statement(database, "UPDATE maps SET previous = NULL WHERE name = ? AND previous = ?")
        .bind(map)
        .bind(version)
        .step();
    for (const char* sql : {"INSERT INTO retired (map, version, digest) SELECT map, name, digest"
                            " FROM versions WHERE map = ? AND name = ? ON CONFLICT DO NOTHING",
                            "DELETE FROM versions WHERE map = ? AND name = ?"})
      Statement(database, sql).bind(map).bind(version).step();
    condemn_unused(database, gone.digest);
    writing.commit();
  });
}

void StoreState::replace_package(std::string_view former, const StoredVersion& converted) {
  const std::string& digest = converted.digest;
  WritingOfPackages writing(inner_->database);
  Database& database = writing.database();
  Statement(database, "UPDATE versions SET digest = ?, bytes = ? WHERE digest = ?")
      .bind(digest)
      .bind(static_cast<std::int64_t>(converted.bytes))
      .bind(former)
      .step();
  // What it went by before that.
  Statement(database, "UPDATE migrated SET digest = ? WHERE digest = ?")
      .bind(digest)
      .bind(former)
      .step();
  Statement(database,
            "INSERT INTO migrated (former, digest) VALUES (?, ?)"
            " ON CONFLICT (former) DO UPDATE SET digest = excluded.digest")
      .bind(former)
      .bind(digest)
      .step();
  Statement(database, "DELETE FROM condemned WHERE digest = ?").bind(digest).step();
  add_files(database, converted);
  condemn_unused(database, former);
  writing.commit();
}

std::vector<std::string> StoreState::packages_without_files() const {
  const Reading reading(inner_->database);
  Statement row(reading.database(),
                "SELECT DISTINCT digest FROM versions"
                " WHERE digest NOT IN (SELECT package FROM package_files)");
  std::vector<std::string> digests;
  while (row.step()) digests.push_back(row.text(0));
  return digests;
}

void StoreState::note_files(std::string_view digest, const FileBytes& files) {
  WritingOfPackages writing(inner_->database);
  StoredVersion version;
  version.digest = digest;
  version.files = files;
  if (is_used(writing.database(), digest)) add_files(writing.database(), version);
  writing.commit();
}

FileBytes StoreState::files() const {
  const Reading reading(inner_->database);
  Statement row(reading.database(), "SELECT DISTINCT sha256, bytes FROM package_files");
  FileBytes files;
  while (row.step()) files.emplace(row.text(0), static_cast<std::uint64_t>(row.integer(1)));
  return files;
}

void StoreState::even_when_full(const std::function<void()>& change) {
  inner_->database.even_when_full(change);
}

void StoreState::keep_ballast() const { inner_->database.keep_ballast(); }

std::string StoreState::not_writable_because() const {
  return inner_->database.not_writable_because();
}

std::chrono::duration<double> StoreState::silence() const { return inner_->database.silence(); }

std::vector<std::string> StoreState::condemned() const {
  const Reading reading(inner_->database);
  Statement row(reading.database(), "SELECT digest FROM condemned ORDER BY digest");
  std::vector<std::string> digests;
  while (row.step()) digests.push_back(row.text(0));
  return digests;
}

void StoreState::forget_condemned(std::string_view digest) {
  inner_->database.even_when_full([&] {
    WritingOfPackages writing(inner_->database);
    Database& database = writing.database();
    Statement(database, "DELETE FROM condemned WHERE digest = ?").bind(digest).step();
    writing.commit();
  });
}

std::vector<std::string> StoreState::problems() const {
  const Reading reading(inner_->database);
  std::vector<std::string> problems;
  if (!inner_->database.is_sqlite()) return problems;
  Statement row(reading.database(), "PRAGMA integrity_check");
  while (row.step())
    if (row.text(0) != "ok") problems.push_back(row.text(0));
  Statement keys(reading.database(), "PRAGMA foreign_key_check");
  while (keys.step()) problems.push_back("a row of " + keys.text(0) + " points to nothing");
  return problems;
}

void StoreState::write_backup(const std::filesystem::path& file, std::int64_t now_ns,
                              DiskCalls& calls) const {
  SqliteDatabase copy(file, calls, SqliteDatabase::Mode::kNewFile);
  inner_->database.copy_to(copy);
  // The copy says that it has a log, as the original has.
  copy.execute("PRAGMA journal_mode=DELETE");
  Transaction transaction(copy);
  copy.execute("DELETE FROM drive_parts; DELETE FROM drives;");
  Statement(copy,
            "UPDATE jobs SET status = 'failed', finished_ns = ?, cancel_requested = 0,"
            " error = 'the store was restored from a backup, which holds no drives'"
            " WHERE status IN ('enqueued', 'processing')")
      .bind(now_ns)
      .step();
  transaction.commit();
}

}  // namespace stillmap::server
