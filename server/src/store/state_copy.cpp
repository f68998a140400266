#include "store/state_copy.hpp"

#include <stillmap/maps/error.hpp>

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "store/durable_files.hpp"
#include "store/folder_lock.hpp"
#include "store/package_store.hpp"
#include "store/schema.hpp"
#include "store/store_folder.hpp"

namespace stillmap::server {
namespace {

/// A table as it is copied: `t` texts, `i` integers, `r` reals.
struct Table {
  std::string_view name;
  std::string_view columns;
  std::string_view kinds;
};

/// What others point to comes first; which version of a map is active comes last.
constexpr Table kTables[] = {
    {"maps", "name, revision, created_ns", "tii"},
    {"versions", "map, name, digest, bytes, created_ns", "tttii"},
    {"condemned", "digest", "t"},
    {"retired", "map, version, digest", "ttt"},
    {"retired_maps", "name, revision", "ti"},
    {"keys", "id, name, scopes, secret_sha256, created_ns, expires_ns, revoked_ns, maps",
     "ttitiiit"},
    {"drives",
     "id, map, name, status, error, created_ns, finished_ns, version, content_type, needs_choice,"
     " inspection, files_at",
     "ittttiittitt"},
    {"drive_parts", "drive, n, sha256, bytes", "iiti"},
    {"jobs",
     "id, kind, map, request, status, stage, error, result_version, attempts, enqueued_ns,"
     " started_ns, finished_ns, asker, idempotency_key, request_sha256, cancel_requested,"
     " server, beat, files_at, fraction, eta_s, outcome, crashes, activates_at",
     "ittttttt"
     "iiiittti"
     "titrrtii"},
    {"job_drives", "job, drive", "ii"},
    {"audit_start", "id, sha256", "it"},
    {"audit",
     "id, time_ns, request_id, key_id, method, route, subject, status, server_request_id, source,"
     " sha256",
     "iitttttittt"},
    {"saved_edits", "map, text, sha256, saved_ns, saver", "tttit"},
    {"migrated", "former, digest", "tt"},
    {"package_files", "package, sha256, bytes", "tti"},
    {"activations", "map, revision, version, time_ns", "titi"},
    {"signatures", "map, package, key, signature", "tttt"},
    {"rollouts",
     "map, version, share, vehicles, least_answers, most_rise, halted, reason, begun_ns",
     "ttrtiriti"},
    {"map_sets", "name, map, x, y, z, qx, qy, qz, qw", "ttrrrrrrr"},
};

void copy_value(const Statement& row, int column, char kind, Statement& into) {
  if (kind == 't')
    into.bind(row.optional_text(column));
  else if (kind == 'i')
    into.bind(row.optional_integer(column));
  else
    into.bind_real(row.real(column));
}

void copy_table(Database& from, Database& to, const Table& table) {
  std::string select = "SELECT ", insert = "INSERT INTO ";
  select.append(table.columns).append(" FROM ").append(table.name);
  insert.append(table.name).append(" (").append(table.columns).append(") VALUES (?");
  for (std::size_t i = 1; i < table.kinds.size(); ++i) insert += ", ?";
  insert += ")";
  Statement row(from, select);
  while (row.step()) {
    Statement into(to, insert);
    for (std::size_t i = 0; i < table.kinds.size(); ++i)
      copy_value(row, static_cast<int>(i), table.kinds[i], into);
    into.step();
  }
}

void copy_active(Database& from, Database& to) {
  Statement row(from, "SELECT active, previous, name FROM maps");
  while (row.step())
    Statement(to, "UPDATE maps SET active = ?, previous = ? WHERE name = ?")
        .bind(row.optional_text(0))
        .bind(row.optional_text(1))
        .bind(row.text(2))
        .step();
}

void require_empty(Database& database) {
  for (const Table& table : kTables) {
    if (table.name == "audit_start") continue;
    Statement row(database, "SELECT 1 FROM " + std::string(table.name) + " LIMIT 1");
    if (row.step())
      throw maps::InputError(database.name(), "rows in the table " + std::string(table.name),
                             "a state with nothing in it: choose another database, or remove the "
                             "schema 'stillmap' of this one");
  }
}

}  // namespace

void copy_state(Database& from, Database& to) {
  const Transaction snapshot(from, Transaction::For::kReading);
  Transaction transaction(to);
  require_empty(to);
  to.execute("DELETE FROM audit_start");
  for (const Table& table : kTables) copy_table(from, to, table);
  copy_active(from, to);
  for (const char* table : {"jobs", "drives", "audit"}) to.set_last_id(table, from.last_id(table));
  transaction.commit();
}

void move_state(const std::filesystem::path& store, const PostgresAddress& to, DiskCalls& calls) {
  const std::filesystem::path file = store / kStateName;
  if (!is_there(file))
    throw maps::InputError(file.string(), "nothing", "the state of a store that has its own");
  // Servers hold it shared.
  const std::optional<FolderLock> lock = FolderLock::try_folder(store);
  if (!lock)
    throw maps::InputError(store.string(), "a store that a server has open",
                           "one that none has: stop it, and ask again");
  PostgresWatch watch(to);
  PostgresDatabase database(to, watch);
  migrate(database);
  {
    // Brings an older one up to date.
    SqliteDatabase own(file, calls);
    migrate(own);
    copy_state(own, database);
  }
  const DurableFiles files(calls);
  files.rename(file, store / kMovedStateName);
  files.sync_folder(store);
  PackageStore::attach(store, to, calls);
}

}  // namespace stillmap::server
