#include <stillmap/maps/store/store_state.hpp>

#include <mutex>
#include <utility>

#include "store/schema.hpp"
#include "store/sqlite_database.hpp"

namespace stillmap::maps {
namespace {

using Reason = StoreRefusal::Reason;

constexpr const char* kMapColumns =
    "SELECT name, active, previous, revision, created_ns FROM maps ";
constexpr const char* kVersionColumns = "SELECT name, digest, bytes, created_ns FROM versions ";

StoredMap map_of(const SqliteStatement& row) {
  return {row.text(0), row.optional_text(1), row.optional_text(2), row.integer(3), row.integer(4)};
}

StoredVersion version_of(const SqliteStatement& row) {
  return {row.text(0), row.text(1), static_cast<std::uint64_t>(row.integer(2)), row.integer(3)};
}

std::string in_quotes(std::string_view name) { return "'" + std::string(name) + "'"; }

std::optional<StoredMap> find_map(SqliteDatabase& database, std::string_view name) {
  SqliteStatement row(database, std::string(kMapColumns) + "WHERE name = ?");
  if (!row.bind(name).step()) return std::nullopt;
  return map_of(row);
}

StoredMap known_map(SqliteDatabase& database, std::string_view name) {
  const std::optional<StoredMap> found = find_map(database, name);
  if (!found) throw StoreRefusal(Reason::kUnknownMap, "there is no map " + in_quotes(name));
  return *found;
}

std::optional<StoredVersion> find_version(SqliteDatabase& database, std::string_view map,
                                          std::string_view name) {
  SqliteStatement row(database, std::string(kVersionColumns) + "WHERE map = ? AND name = ?");
  if (!row.bind(map).bind(name).step()) return std::nullopt;
  return version_of(row);
}

StoredVersion known_version(SqliteDatabase& database, std::string_view map, std::string_view name) {
  const std::optional<StoredVersion> found = find_version(database, map, name);
  if (!found)
    throw StoreRefusal(Reason::kUnknownVersion,
                       "map " + in_quotes(map) + " has no version " + in_quotes(name));
  return *found;
}

bool is_used(SqliteDatabase& database, std::string_view digest) {
  return SqliteStatement(database, "SELECT 1 FROM versions WHERE digest = ?").bind(digest).step();
}

void check_revision(const StoredMap& map, std::optional<std::int64_t> revision) {
  if (!revision || *revision == map.revision) return;
  throw StoreRefusal(Reason::kOtherRevision, "map " + in_quotes(map.name) + " is at revision " +
                                                 std::to_string(map.revision) + ", not " +
                                                 std::to_string(*revision));
}

StoredMap point_to(SqliteDatabase& database, StoredMap map, const std::string& version) {
  map.previous = std::exchange(map.active, version);
  ++map.revision;
  SqliteStatement(database, "UPDATE maps SET active = ?, previous = ?, revision = ? WHERE name = ?")
      .bind(map.active)
      .bind(map.previous)
      .bind(map.revision)
      .bind(std::string_view(map.name))
      .step();
  return map;
}

}  // namespace

struct StoreState::Inner {
  Inner(const std::filesystem::path& file, DiskCalls& calls) : database(file, calls) {}
  std::mutex mutex;
  SqliteDatabase database;
};

StoreState::StoreState(const std::filesystem::path& file, DiskCalls& calls)
    : inner_(std::make_unique<Inner>(file, calls)) {
  migrate(inner_->database);
}

StoreState::~StoreState() = default;

std::vector<StoredMap> StoreState::maps() const {
  const std::scoped_lock lock(inner_->mutex);
  SqliteStatement row(inner_->database, std::string(kMapColumns) + "ORDER BY name");
  std::vector<StoredMap> maps;
  while (row.step()) maps.push_back(map_of(row));
  return maps;
}

StoredMap StoreState::map(std::string_view name) const {
  const std::scoped_lock lock(inner_->mutex);
  return known_map(inner_->database, name);
}

std::vector<StoredVersion> StoreState::versions(std::string_view map) const {
  const std::scoped_lock lock(inner_->mutex);
  known_map(inner_->database, map);
  SqliteStatement row(inner_->database,
                      std::string(kVersionColumns) + "WHERE map = ? ORDER BY created_ns, name");
  row.bind(map);
  std::vector<StoredVersion> versions;
  while (row.step()) versions.push_back(version_of(row));
  return versions;
}

StoredVersion StoreState::version(std::string_view map, std::string_view version) const {
  const std::scoped_lock lock(inner_->mutex);
  known_map(inner_->database, map);
  return known_version(inner_->database, map, version);
}

std::optional<StoredVersion> StoreState::find_version(std::string_view map,
                                                      std::string_view version) const {
  const std::scoped_lock lock(inner_->mutex);
  return maps::find_version(inner_->database, map, version);
}

bool StoreState::uses(std::string_view digest) const {
  const std::scoped_lock lock(inner_->mutex);
  return is_used(inner_->database, digest);
}

bool StoreState::add_version(std::string_view map, const StoredVersion& version) {
  const std::scoped_lock lock(inner_->mutex);
  SqliteDatabase& database = inner_->database;
  SqliteTransaction transaction(database);
  if (const auto known = maps::find_version(database, map, version.name)) {
    if (known->digest == version.digest) return false;
    throw StoreRefusal(Reason::kOtherDigest, "version " + in_quotes(version.name) + " of map " +
                                                 in_quotes(map) + " is " + known->digest);
  }
  SqliteStatement(database, "INSERT OR IGNORE INTO maps (name, created_ns) VALUES (?, ?)")
      .bind(map)
      .bind(version.created_ns)
      .step();
  SqliteStatement(database, "INSERT INTO versions VALUES (?, ?, ?, ?, ?)")
      .bind(map)
      .bind(std::string_view(version.name))
      .bind(std::string_view(version.digest))
      .bind(static_cast<std::int64_t>(version.bytes))
      .bind(version.created_ns)
      .step();
  SqliteStatement(database, "DELETE FROM condemned WHERE digest = ?")
      .bind(std::string_view(version.digest))
      .step();
  transaction.commit();
  return true;
}

StoredMap StoreState::activate(std::string_view map, std::string_view version,
                               std::optional<std::int64_t> revision) {
  const std::scoped_lock lock(inner_->mutex);
  SqliteTransaction transaction(inner_->database);
  const StoredMap now = known_map(inner_->database, map);
  check_revision(now, revision);
  known_version(inner_->database, map, version);
  if (now.active == version) return now;
  StoredMap then = point_to(inner_->database, now, std::string(version));
  transaction.commit();
  return then;
}

StoredMap StoreState::roll_back(std::string_view map, std::optional<std::int64_t> revision) {
  const std::scoped_lock lock(inner_->mutex);
  SqliteTransaction transaction(inner_->database);
  const StoredMap now = known_map(inner_->database, map);
  check_revision(now, revision);
  if (!now.previous)
    throw StoreRefusal(Reason::kNoPrevious,
                       "map " + in_quotes(map) + " has no version before this");
  StoredMap then = point_to(inner_->database, now, *now.previous);
  transaction.commit();
  return then;
}

void StoreState::remove_version(std::string_view map, std::string_view version) {
  const std::scoped_lock lock(inner_->mutex);
  SqliteDatabase& database = inner_->database;
  SqliteTransaction transaction(database);
  const StoredMap now = known_map(database, map);
  const StoredVersion gone = known_version(database, map, version);
  if (now.active == version)
    throw StoreRefusal(Reason::kActive, "version " + in_quotes(version) + " of map " +
                                            in_quotes(map) + " is active");
  SqliteStatement(database, "UPDATE maps SET previous = NULL WHERE name = ? AND previous = ?")
      .bind(map)
      .bind(version)
      .step();
  SqliteStatement(database, "DELETE FROM versions WHERE map = ? AND name = ?")
      .bind(map)
      .bind(version)
      .step();
  if (!is_used(database, gone.digest))
    SqliteStatement(database, "INSERT OR IGNORE INTO condemned VALUES (?)")
        .bind(std::string_view(gone.digest))
        .step();
  transaction.commit();
}

std::vector<std::string> StoreState::condemned() const {
  const std::scoped_lock lock(inner_->mutex);
  SqliteStatement row(inner_->database, "SELECT digest FROM condemned ORDER BY digest");
  std::vector<std::string> digests;
  while (row.step()) digests.push_back(row.text(0));
  return digests;
}

void StoreState::forget_condemned(std::string_view digest) {
  const std::scoped_lock lock(inner_->mutex);
  SqliteTransaction transaction(inner_->database);
  SqliteStatement(inner_->database, "DELETE FROM condemned WHERE digest = ?").bind(digest).step();
  transaction.commit();
}

std::vector<std::string> StoreState::problems() const {
  const std::scoped_lock lock(inner_->mutex);
  std::vector<std::string> problems;
  SqliteStatement row(inner_->database, "PRAGMA integrity_check");
  while (row.step())
    if (row.text(0) != "ok") problems.push_back(row.text(0));
  SqliteStatement keys(inner_->database, "PRAGMA foreign_key_check");
  while (keys.step()) problems.push_back("a row of " + keys.text(0) + " points to nothing");
  return problems;
}

}  // namespace stillmap::maps
