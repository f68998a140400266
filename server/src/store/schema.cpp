#include "store/schema.hpp"

#include <stillmap/maps/error.hpp>

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "store/audit_chain.hpp"

namespace stillmap::server {
namespace {

/// "STMP": tells a store's database from any other.
constexpr std::int64_t kApplicationId = 0x53544d50;

/// Servers of several versions share a state in PostgreSQL while they are replaced one by one: this
/// is the schema version that a program must know to use what this one has made. Steps that add a
/// table, or a column with a default, leave it.
constexpr std::int64_t kLeastProgram = 9;

/// Step n takes version n to n + 1. A published step is never changed, only followed by others.
/// The fifth goes on in `chain_old_audit_records`. From the tenth on they are for PostgreSQL too.
constexpr std::array<const char*, 13> kSteps = {
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
    R"(
CREATE TABLE retired (
  map TEXT NOT NULL,
  version TEXT NOT NULL,
  digest TEXT NOT NULL,
  PRIMARY KEY (map, version)
) STRICT, WITHOUT ROWID;
CREATE TABLE keys (
  id TEXT PRIMARY KEY NOT NULL,
  name TEXT NOT NULL,
  scopes INTEGER NOT NULL CHECK (scopes BETWEEN 1 AND 15),
  secret_sha256 TEXT NOT NULL CHECK (length(secret_sha256) = 64),
  created_ns INTEGER NOT NULL,
  expires_ns INTEGER,
  revoked_ns INTEGER
) STRICT, WITHOUT ROWID;
CREATE TABLE jobs (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  kind TEXT NOT NULL CHECK (kind IN ('rebuild', 'convert')),
  map TEXT NOT NULL,
  request TEXT NOT NULL,
  status TEXT NOT NULL
    CHECK (status IN ('enqueued', 'processing', 'succeeded', 'failed', 'canceled')),
  stage TEXT NOT NULL DEFAULT '',
  error TEXT NOT NULL DEFAULT '',
  result_version TEXT,
  attempts INTEGER NOT NULL DEFAULT 0,
  enqueued_ns INTEGER NOT NULL,
  started_ns INTEGER,
  finished_ns INTEGER,
  asker TEXT NOT NULL,
  idempotency_key TEXT,
  request_sha256 TEXT NOT NULL CHECK (length(request_sha256) = 64),
  cancel_requested INTEGER NOT NULL DEFAULT 0
) STRICT;
CREATE UNIQUE INDEX jobs_by_idempotency_key ON jobs (asker, idempotency_key)
  WHERE idempotency_key IS NOT NULL;
CREATE INDEX jobs_by_status ON jobs (status, id);
CREATE INDEX jobs_by_map ON jobs (map, id);
CREATE TABLE drives (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  map TEXT NOT NULL REFERENCES maps (name),
  name TEXT NOT NULL,
  status TEXT NOT NULL CHECK (status IN ('open', 'complete', 'failed')),
  error TEXT NOT NULL DEFAULT '',
  created_ns INTEGER NOT NULL,
  finished_ns INTEGER
) STRICT;
CREATE INDEX drives_by_map ON drives (map, id);
CREATE TABLE drive_parts (
  drive INTEGER NOT NULL REFERENCES drives (id),
  n INTEGER NOT NULL CHECK (n BETWEEN 1 AND 10000),
  sha256 TEXT NOT NULL CHECK (length(sha256) = 64),
  bytes INTEGER NOT NULL CHECK (bytes >= 0),
  PRIMARY KEY (drive, n)
) STRICT, WITHOUT ROWID;
CREATE TABLE job_drives (
  job INTEGER NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
  drive INTEGER NOT NULL,
  PRIMARY KEY (job, drive)
) STRICT, WITHOUT ROWID;
CREATE INDEX job_drives_by_drive ON job_drives (drive, job);
CREATE TABLE audit (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  time_ns INTEGER NOT NULL,
  request_id TEXT NOT NULL,
  key_id TEXT NOT NULL,
  method TEXT NOT NULL,
  route TEXT NOT NULL,
  subject TEXT NOT NULL,
  status INTEGER NOT NULL
) STRICT;
CREATE INDEX audit_by_time ON audit (time_ns);
CREATE TRIGGER audit_is_append_only BEFORE UPDATE ON audit
  BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END;
)",
    R"(
CREATE TABLE retired_maps (
  name TEXT PRIMARY KEY NOT NULL,
  revision INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
)",
    R"(
CREATE TABLE saved_edits (
  map TEXT PRIMARY KEY NOT NULL REFERENCES maps (name),
  text TEXT NOT NULL,
  sha256 TEXT NOT NULL CHECK (length(sha256) = 64),
  saved_ns INTEGER NOT NULL,
  saver TEXT NOT NULL
) STRICT, WITHOUT ROWID;
ALTER TABLE drives ADD COLUMN version TEXT;
ALTER TABLE drives ADD COLUMN content_type TEXT;
)",
    R"(
ALTER TABLE keys ADD COLUMN maps TEXT NOT NULL DEFAULT '';
ALTER TABLE audit ADD COLUMN server_request_id TEXT NOT NULL DEFAULT '';
ALTER TABLE audit ADD COLUMN source TEXT NOT NULL DEFAULT '';
ALTER TABLE audit ADD COLUMN sha256 TEXT NOT NULL DEFAULT '';
CREATE TABLE audit_start (
  id INTEGER NOT NULL,
  sha256 TEXT NOT NULL CHECK (length(sha256) = 64)
) STRICT;
INSERT INTO audit_start SELECT
  coalesce((SELECT min(id) - 1 FROM audit), (SELECT seq FROM sqlite_sequence WHERE name = 'audit'), 0),
  '0000000000000000000000000000000000000000000000000000000000000000';
UPDATE sqlite_sequence SET seq = (SELECT max(id) FROM audit)
  WHERE name = 'audit' AND EXISTS (SELECT 1 FROM audit);
DROP TRIGGER audit_is_append_only;
CREATE TRIGGER audit_is_append_only BEFORE UPDATE ON audit WHEN old.sha256 <> ''
  BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END;
)",
    R"(
ALTER TABLE drives ADD COLUMN needs_choice INTEGER NOT NULL DEFAULT 0;
ALTER TABLE drives ADD COLUMN inspection TEXT NOT NULL DEFAULT '';
)",
    R"(
CREATE TABLE migrated (
  former TEXT PRIMARY KEY NOT NULL CHECK (length(former) = 64),
  digest TEXT NOT NULL CHECK (length(digest) = 64)
) STRICT, WITHOUT ROWID;
CREATE INDEX migrated_by_digest ON migrated (digest);
)",
    R"(
CREATE TABLE package_files (
  package TEXT NOT NULL CHECK (length(package) = 64),
  sha256 TEXT NOT NULL CHECK (length(sha256) = 64),
  bytes INTEGER NOT NULL CHECK (bytes >= 0),
  PRIMARY KEY (package, sha256)
) STRICT, WITHOUT ROWID;
CREATE INDEX package_files_by_sha256 ON package_files (sha256, package);
CREATE TABLE activations (
  map TEXT NOT NULL REFERENCES maps (name),
  revision INTEGER NOT NULL,
  version TEXT NOT NULL,
  time_ns INTEGER NOT NULL,
  PRIMARY KEY (map, revision)
) STRICT, WITHOUT ROWID;
INSERT INTO activations SELECT maps.name, maps.revision, active, versions.created_ns
  FROM maps JOIN versions ON versions.map = maps.name AND versions.name = active;
CREATE TABLE signatures (
  map TEXT NOT NULL,
  package TEXT NOT NULL CHECK (length(package) = 64),
  key TEXT NOT NULL CHECK (length(key) = 64),
  signature TEXT NOT NULL CHECK (length(signature) = 128),
  PRIMARY KEY (map, package, key)
) STRICT, WITHOUT ROWID;
)",
    R"(
CREATE TABLE rollouts (
  map TEXT PRIMARY KEY NOT NULL REFERENCES maps (name),
  version TEXT NOT NULL,
  share REAL NOT NULL CHECK (share BETWEEN 0 AND 1),
  vehicles TEXT NOT NULL,
  least_answers INTEGER NOT NULL,
  most_rise REAL NOT NULL,
  halted INTEGER NOT NULL CHECK (halted IN (0, 1)),
  reason TEXT NOT NULL,
  begun_ns INTEGER NOT NULL,
  FOREIGN KEY (map, version) REFERENCES versions (map, name)
) STRICT, WITHOUT ROWID;
)",
    R"(
ALTER TABLE jobs ADD COLUMN server TEXT NOT NULL DEFAULT '';
ALTER TABLE jobs ADD COLUMN beat INTEGER NOT NULL DEFAULT 0;
)",
    R"(
CREATE TABLE seal_keys (
  made_ns INTEGER PRIMARY KEY NOT NULL,
  secret TEXT NOT NULL CHECK (length(secret) = 64)
) STRICT, WITHOUT ROWID;
)",
    R"(
CREATE TABLE map_sets (
  name TEXT NOT NULL,
  map TEXT NOT NULL REFERENCES maps (name),
  x REAL NOT NULL,
  y REAL NOT NULL,
  z REAL NOT NULL,
  qx REAL NOT NULL,
  qy REAL NOT NULL,
  qz REAL NOT NULL,
  qw REAL NOT NULL,
  PRIMARY KEY (name, map)
) STRICT, WITHOUT ROWID;
)",
    R"(
ALTER TABLE drives ADD COLUMN files_at TEXT NOT NULL DEFAULT '';
ALTER TABLE jobs ADD COLUMN files_at TEXT NOT NULL DEFAULT '';
ALTER TABLE jobs ADD COLUMN fraction REAL NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN eta_s REAL NOT NULL DEFAULT -1;
ALTER TABLE jobs ADD COLUMN outcome TEXT NOT NULL DEFAULT '';
ALTER TABLE jobs ADD COLUMN crashes INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN activates_at INTEGER;
)",
};

/// PostgreSQL begins with what the first nine steps come to.
constexpr std::int64_t kPostgresBegins = 9;
constexpr const char* kPostgresBegin = R"(
CREATE TABLE schema_version (version INTEGER NOT NULL, least_program INTEGER NOT NULL);
INSERT INTO schema_version VALUES (0, 0);
CREATE TABLE changes (n INTEGER NOT NULL);
INSERT INTO changes VALUES (0);
CREATE TABLE given_ids (name TEXT PRIMARY KEY, last INTEGER NOT NULL);
INSERT INTO given_ids VALUES ('jobs', 0), ('drives', 0), ('audit', 0);
CREATE FUNCTION give_id() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  UPDATE stillmap.given_ids SET last = greatest(coalesce(new.id, last + 1), last)
    WHERE name = tg_table_name RETURNING coalesce(new.id, last) INTO new.id;
  RETURN new;
END $$;
CREATE TABLE maps (
  name TEXT PRIMARY KEY,
  active TEXT,
  previous TEXT,
  revision INTEGER NOT NULL DEFAULT 0,
  created_ns INTEGER NOT NULL
);
CREATE TABLE versions (
  map TEXT NOT NULL REFERENCES maps (name),
  name TEXT NOT NULL,
  digest TEXT NOT NULL CHECK (length(digest) = 64),
  bytes INTEGER NOT NULL,
  created_ns INTEGER NOT NULL,
  PRIMARY KEY (map, name)
);
ALTER TABLE maps ADD FOREIGN KEY (name, active) REFERENCES versions (map, name);
ALTER TABLE maps ADD FOREIGN KEY (name, previous) REFERENCES versions (map, name);
CREATE INDEX versions_by_digest ON versions (digest);
CREATE TABLE condemned (digest TEXT PRIMARY KEY);
CREATE TABLE retired (
  map TEXT NOT NULL,
  version TEXT NOT NULL,
  digest TEXT NOT NULL,
  PRIMARY KEY (map, version)
);
CREATE TABLE keys (
  id TEXT PRIMARY KEY,
  name TEXT NOT NULL,
  scopes INTEGER NOT NULL CHECK (scopes BETWEEN 1 AND 15),
  secret_sha256 TEXT NOT NULL CHECK (length(secret_sha256) = 64),
  created_ns INTEGER NOT NULL,
  expires_ns INTEGER,
  revoked_ns INTEGER,
  maps TEXT NOT NULL DEFAULT ''
);
CREATE TABLE jobs (
  id INTEGER PRIMARY KEY,
  kind TEXT NOT NULL CHECK (kind IN ('rebuild', 'convert')),
  map TEXT NOT NULL,
  request TEXT NOT NULL,
  status TEXT NOT NULL
    CHECK (status IN ('enqueued', 'processing', 'succeeded', 'failed', 'canceled')),
  stage TEXT NOT NULL DEFAULT '',
  error TEXT NOT NULL DEFAULT '',
  result_version TEXT,
  attempts INTEGER NOT NULL DEFAULT 0,
  enqueued_ns INTEGER NOT NULL,
  started_ns INTEGER,
  finished_ns INTEGER,
  asker TEXT NOT NULL,
  idempotency_key TEXT,
  request_sha256 TEXT NOT NULL CHECK (length(request_sha256) = 64),
  cancel_requested INTEGER NOT NULL DEFAULT 0
);
CREATE UNIQUE INDEX jobs_by_idempotency_key ON jobs (asker, idempotency_key)
  WHERE idempotency_key IS NOT NULL;
CREATE INDEX jobs_by_status ON jobs (status, id);
CREATE INDEX jobs_by_map ON jobs (map, id);
CREATE TABLE drives (
  id INTEGER PRIMARY KEY,
  map TEXT NOT NULL REFERENCES maps (name),
  name TEXT NOT NULL,
  status TEXT NOT NULL CHECK (status IN ('open', 'complete', 'failed')),
  error TEXT NOT NULL DEFAULT '',
  created_ns INTEGER NOT NULL,
  finished_ns INTEGER,
  version TEXT,
  content_type TEXT,
  needs_choice INTEGER NOT NULL DEFAULT 0,
  inspection TEXT NOT NULL DEFAULT ''
);
CREATE INDEX drives_by_map ON drives (map, id);
CREATE TABLE drive_parts (
  drive INTEGER NOT NULL REFERENCES drives (id),
  n INTEGER NOT NULL CHECK (n BETWEEN 1 AND 10000),
  sha256 TEXT NOT NULL CHECK (length(sha256) = 64),
  bytes INTEGER NOT NULL CHECK (bytes >= 0),
  PRIMARY KEY (drive, n)
);
CREATE TABLE job_drives (
  job INTEGER NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
  drive INTEGER NOT NULL,
  PRIMARY KEY (job, drive)
);
CREATE INDEX job_drives_by_drive ON job_drives (drive, job);
CREATE TABLE audit (
  id INTEGER PRIMARY KEY,
  time_ns INTEGER NOT NULL,
  request_id TEXT NOT NULL,
  key_id TEXT NOT NULL,
  method TEXT NOT NULL,
  route TEXT NOT NULL,
  subject TEXT NOT NULL,
  status INTEGER NOT NULL,
  server_request_id TEXT NOT NULL DEFAULT '',
  source TEXT NOT NULL DEFAULT '',
  sha256 TEXT NOT NULL DEFAULT ''
);
CREATE INDEX audit_by_time ON audit (time_ns);
CREATE FUNCTION refuse_update() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  RAISE EXCEPTION 'the audit log is append-only';
END $$;
CREATE TRIGGER audit_is_append_only BEFORE UPDATE ON audit
  FOR EACH ROW EXECUTE FUNCTION refuse_update();
CREATE TABLE audit_start (id INTEGER NOT NULL, sha256 TEXT NOT NULL CHECK (length(sha256) = 64));
INSERT INTO audit_start VALUES (0, repeat('0', 64));
CREATE TRIGGER jobs_id BEFORE INSERT ON jobs FOR EACH ROW EXECUTE FUNCTION give_id();
CREATE TRIGGER drives_id BEFORE INSERT ON drives FOR EACH ROW EXECUTE FUNCTION give_id();
CREATE TRIGGER audit_id BEFORE INSERT ON audit FOR EACH ROW EXECUTE FUNCTION give_id();
CREATE TABLE retired_maps (name TEXT PRIMARY KEY, revision INTEGER NOT NULL);
CREATE TABLE saved_edits (
  map TEXT PRIMARY KEY REFERENCES maps (name),
  text TEXT NOT NULL,
  sha256 TEXT NOT NULL CHECK (length(sha256) = 64),
  saved_ns INTEGER NOT NULL,
  saver TEXT NOT NULL
);
CREATE TABLE migrated (
  former TEXT PRIMARY KEY CHECK (length(former) = 64),
  digest TEXT NOT NULL CHECK (length(digest) = 64)
);
CREATE INDEX migrated_by_digest ON migrated (digest);
CREATE TABLE package_files (
  package TEXT NOT NULL CHECK (length(package) = 64),
  sha256 TEXT NOT NULL CHECK (length(sha256) = 64),
  bytes INTEGER NOT NULL CHECK (bytes >= 0),
  PRIMARY KEY (package, sha256)
);
CREATE INDEX package_files_by_sha256 ON package_files (sha256, package);
CREATE TABLE activations (
  map TEXT NOT NULL REFERENCES maps (name),
  revision INTEGER NOT NULL,
  version TEXT NOT NULL,
  time_ns INTEGER NOT NULL,
  PRIMARY KEY (map, revision)
);
CREATE TABLE signatures (
  map TEXT NOT NULL,
  package TEXT NOT NULL CHECK (length(package) = 64),
  key TEXT NOT NULL CHECK (length(key) = 64),
  signature TEXT NOT NULL CHECK (length(signature) = 128),
  PRIMARY KEY (map, package, key)
);
CREATE TABLE rollouts (
  map TEXT PRIMARY KEY REFERENCES maps (name),
  version TEXT NOT NULL,
  share REAL NOT NULL CHECK (share BETWEEN 0 AND 1),
  vehicles TEXT NOT NULL,
  least_answers INTEGER NOT NULL,
  most_rise REAL NOT NULL,
  halted INTEGER NOT NULL CHECK (halted IN (0, 1)),
  reason TEXT NOT NULL,
  begun_ns INTEGER NOT NULL,
  FOREIGN KEY (map, version) REFERENCES versions (map, name)
);
)";

/// SQLite's types as PostgreSQL's: numbers of 64 bits, texts in the order of their bytes.
std::string as_postgres(std::string sql) {
  constexpr std::array<std::pair<std::string_view, std::string_view>, 5> kWords = {{
      {" INTEGER", " BIGINT"},
      {" TEXT", " TEXT COLLATE \"C\""},
      {" REAL", " DOUBLE PRECISION"},
      {" STRICT, WITHOUT ROWID", ""},
      {" STRICT", ""},
  }};
  for (const auto& [word, wanted] : kWords) {
    for (std::size_t at = 0; (at = sql.find(word, at)) != std::string::npos;) {
      sql.replace(at, word.size(), wanted);
      at += wanted.size();
    }
  }
  return sql;
}

void refuse_newer(const Database& database, std::int64_t version, std::int64_t newest) {
  if (version < 0 || version > newest)
    throw maps::InputError(database.name(), "schema version " + std::to_string(version),
                           "at most " + std::to_string(newest) +
                               "; a newer stillmap wrote it: use that one, or restore a backup");
}

void refuse_foreign(SqliteDatabase& database, std::int64_t version) {
  const std::int64_t application = database.pragma("application_id");
  Statement tables(database, "SELECT count(*) FROM sqlite_schema");
  tables.step();
  const bool fresh = application == 0 && version == 0 && tables.integer(0) == 0;
  if (!fresh && application != kApplicationId)
    throw maps::InputError(database.name(), "a database of something else",
                           "the state of a map store");
}

/// @return nothing where there are no tables. @throws InputError when a newer program wrote it.
std::optional<std::int64_t> version_of(PostgresDatabase& database) {
  Statement is_new(database, "SELECT to_regclass('stillmap.schema_version') IS NULL");
  is_new.step();
  if (is_new.text(0) == "t") return std::nullopt;
  Statement row(database, "SELECT version, least_program FROM schema_version");
  row.step();
  // A newer program's state is good for this one as far as that one says.
  refuse_newer(database, row.integer(1), static_cast<std::int64_t>(kSteps.size()));
  return row.integer(0);
}

}  // namespace

int schema_version() { return static_cast<int>(kSteps.size()); }

void migrate(SqliteDatabase& database) {
  std::int64_t version = database.pragma("user_version");
  refuse_foreign(database, version);
  const auto newest = static_cast<std::int64_t>(kSteps.size());
  refuse_newer(database, version, newest);
  while (version < newest) {
    Transaction transaction(database);
    // Another process may have been first.
    if (database.pragma("user_version") == version) {
      constexpr std::int64_t kChain = 4;
      database.execute(kSteps.at(static_cast<std::size_t>(version)));
      if (version == kChain) chain_old_audit_records(database);
      database.execute("PRAGMA application_id=" + std::to_string(kApplicationId) +
                       "; PRAGMA user_version=" + std::to_string(version + 1));
    }
    transaction.commit();
    version = database.pragma("user_version");
  }
}

void migrate(PostgresDatabase& database) {
  const auto newest = static_cast<std::int64_t>(kSteps.size());
  // A server starts also while nothing can be written.
  {
    const Transaction reading(database, Transaction::For::kReading);
    const std::optional<std::int64_t> version = version_of(database);
    if (version && *version >= newest) return;
  }
  Transaction transaction(database);
  // Another process may have been first.
  std::optional<std::int64_t> version = version_of(database);
  if (version && *version >= newest) return;
  if (!version) {
    database.execute("CREATE SCHEMA IF NOT EXISTS stillmap");
    database.execute(as_postgres(kPostgresBegin));
    version = kPostgresBegins;
  }
  for (std::int64_t step = *version; step < newest; ++step)
    database.execute(as_postgres(kSteps.at(static_cast<std::size_t>(step))));
  Statement(database, "UPDATE schema_version SET version = ?, least_program = ?")
      .bind(newest)
      .bind(kLeastProgram)
      .step();
  transaction.commit();
}

}  // namespace stillmap::server
