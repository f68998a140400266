#include "store/schema.hpp"

#include <stillmap/maps/error.hpp>

#include <array>
#include <string>

namespace stillmap::maps {
namespace {

/// "STMP": tells a store's database from any other.
constexpr std::int64_t kApplicationId = 0x53544d50;

/// Step n takes version n to n + 1. A published step is never changed, only followed by others.
constexpr std::array<const char*, 1> kSteps = {
    R"(
CREATE TABLE maps (
  name TEXT PRIMARY KEY NOT NULL,
  active TEXT,
  previous TEXT,
  revision INTEGER NOT NULL DEFAULT 0,
  created_ns INTEGER NOT NULL,
  FOREIGN KEY (name, active) REFERENCES versions (map, name),
  FOREIGN KEY (name, previous) REFERENCES versions (map, name)
) STRICT, WITHOUT ROWID;
CREATE TABLE versions (
  map TEXT NOT NULL REFERENCES maps (name),
  name TEXT NOT NULL,
  digest TEXT NOT NULL CHECK (length(digest) = 64),
  bytes INTEGER NOT NULL,
  created_ns INTEGER NOT NULL,
  PRIMARY KEY (map, name)
) STRICT, WITHOUT ROWID;
CREATE INDEX versions_by_digest ON versions (digest);
CREATE TABLE condemned (
  digest TEXT PRIMARY KEY NOT NULL
) STRICT, WITHOUT ROWID;
)",
};

void refuse_foreign(SqliteDatabase& database, std::int64_t version) {
  const std::int64_t application = database.pragma("application_id");
  SqliteStatement tables(database, "SELECT count(*) FROM sqlite_schema");
  tables.step();
  const bool fresh = application == 0 && version == 0 && tables.integer(0) == 0;
  if (!fresh && application != kApplicationId)
    throw InputError(database.file().string(), "a database of something else",
                     "the state of a map store");
}

}  // namespace

int schema_version() { return static_cast<int>(kSteps.size()); }

void migrate(SqliteDatabase& database) {
  std::int64_t version = database.pragma("user_version");
  refuse_foreign(database, version);
  const auto newest = static_cast<std::int64_t>(kSteps.size());
  if (version < 0 || version > newest)
    throw InputError(database.file().string(), "schema version " + std::to_string(version),
                     "at most " + std::to_string(newest) + "; a newer stillmap wrote it");
  while (version < newest) {
    SqliteTransaction transaction(database);
    // Another process may have been first.
    if (database.pragma("user_version") == version) {
      database.execute(kSteps.at(static_cast<std::size_t>(version)));
      database.execute("PRAGMA application_id=" + std::to_string(kApplicationId) +
                       "; PRAGMA user_version=" + std::to_string(version + 1));
    }
    transaction.commit();
    version = database.pragma("user_version");
  }
}

}  // namespace stillmap::maps
