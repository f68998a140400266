#include "store/sqlite_database.hpp"

#include <stillmap/maps/error.hpp>

#include <sqlite3.h>

#include <cstring>
#include <string>
#include <utility>

namespace stillmap::maps {

SqliteDatabase::SqliteDatabase(std::filesystem::path file, DiskCalls& calls)
    : file_(std::filesystem::absolute(file).lexically_normal()), vfs_(calls) {
  // Another process may hold the write lock for the length of one commit and its syncs.
  constexpr int kBusyMs = 10'000;
  const int code = sqlite3_open_v2(
      file_.c_str(), &connection_,
      SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOFOLLOW, vfs_.name().c_str());
  try {
    if (code != SQLITE_OK) fail();
    sqlite3_extended_result_codes(connection_, 1);
    sqlite3_busy_timeout(connection_, kBusyMs);
    execute(
        "PRAGMA foreign_keys=ON; PRAGMA temp_store=MEMORY; PRAGMA mmap_size=0;"
        "PRAGMA trusted_schema=OFF; PRAGMA cell_size_check=ON; PRAGMA synchronous=FULL;");
    SqliteStatement mode(*this, "PRAGMA journal_mode=WAL");
    if (!mode.step() || mode.text(0) != "wal")
      throw StorageError(file_.string(), "its disk does not allow a write-ahead log");
  } catch (...) {
    close();
    throw;
  }
}

SqliteDatabase::~SqliteDatabase() { close(); }

void SqliteDatabase::close() { sqlite3_close_v2(std::exchange(connection_, nullptr)); }

void SqliteDatabase::fail() {
  if (connection_ == nullptr) throw StorageError(file_.string(), "no memory");
  std::string reason = sqlite3_errmsg(connection_);
  const int code = sqlite3_errcode(connection_) & 0xff;
  const bool of_disk = code == SQLITE_IOERR || code == SQLITE_FULL || code == SQLITE_CANTOPEN;
  const int changing = vfs_.take_failure();
  const int failure = changing != 0 ? changing : sqlite3_system_errno(connection_);
  if (of_disk && failure != 0) reason += std::string(" (") + std::strerror(failure) + ")";
  throw StorageError(file_.string(), reason);
}

void SqliteDatabase::execute(const std::string& sql) {
  if (sqlite3_exec(connection_, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) fail();
}

std::int64_t SqliteDatabase::pragma(const std::string& name) {
  SqliteStatement statement(*this, "PRAGMA " + name);
  return statement.step() ? statement.integer(0) : 0;
}

SqliteStatement::SqliteStatement(SqliteDatabase& database, std::string_view sql)
    : database_(database) {
  check(sqlite3_prepare_v2(database.connection_, sql.data(), static_cast<int>(sql.size()),
                           &statement_, nullptr));
}

SqliteStatement::~SqliteStatement() { sqlite3_finalize(statement_); }

void SqliteStatement::check(int code) const {
  if (code != SQLITE_OK) database_.fail();
}

SqliteStatement& SqliteStatement::bind(std::string_view text) {
  check(sqlite3_bind_text(statement_, ++bound_, text.data(), static_cast<int>(text.size()),
                          SQLITE_TRANSIENT));
  return *this;
}

SqliteStatement& SqliteStatement::bind(std::int64_t number) {
  check(sqlite3_bind_int64(statement_, ++bound_, number));
  return *this;
}

SqliteStatement& SqliteStatement::bind(const std::optional<std::string>& text) {
  if (text) return bind(std::string_view(*text));
  check(sqlite3_bind_null(statement_, ++bound_));
  return *this;
}

bool SqliteStatement::step() {
  const int code = sqlite3_step(statement_);
  if (code != SQLITE_ROW && code != SQLITE_DONE) database_.fail();
  return code == SQLITE_ROW;
}

std::string SqliteStatement::text(int column) const {
  return optional_text(column).value_or(std::string());
}

std::optional<std::string> SqliteStatement::optional_text(int column) const {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
  if (text == nullptr) return std::nullopt;
  return std::string(text, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)));
}

std::int64_t SqliteStatement::integer(int column) const {
  return sqlite3_column_int64(statement_, column);
}

SqliteTransaction::SqliteTransaction(SqliteDatabase& database) : database_(database) {
  if (database.vfs_.sync_failed())
    throw StorageError(database.file_.string(),
                       "an earlier sync failed, so nothing more is written; open the store again");
  database_.execute("BEGIN IMMEDIATE");
}

SqliteTransaction::~SqliteTransaction() {
  // A failed commit may have ended it already.
  if (open_ && sqlite3_get_autocommit(database_.connection_) == 0)
    sqlite3_exec(database_.connection_, "ROLLBACK", nullptr, nullptr, nullptr);
}

void SqliteTransaction::commit() {
  database_.execute("COMMIT");
  open_ = false;
}

}  // namespace stillmap::maps
