#include "store/sqlite_database.hpp"

#include "store/disk_full.hpp"

#include <sqlite3.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <system_error>
#include <utility>

namespace stillmap::server {

namespace {

/// Another process may hold the write lock for the length of one commit and its syncs.
constexpr int kBusyMs = 10'000;

int flags_of(SqliteDatabase::Mode mode) {
  if (mode == SqliteDatabase::Mode::kRead) return SQLITE_OPEN_READONLY | SQLITE_OPEN_NOFOLLOW;
  return SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOFOLLOW;
}

/// "file:" and the path, as SQLite reads an URI.
std::string uri_of(const std::filesystem::path& file) {
  constexpr std::string_view kDigits = "0123456789ABCDEF";
  std::string uri = "file:";
  for (const char c : file.string()) {
    const auto byte = static_cast<unsigned char>(c);
    if (c != '?' && c != '#' && c != '%') {
      uri += c;
      continue;
    }
    uri += {'%', kDigits[byte >> 4U], kDigits[byte & 15U]};
  }
  return uri;
}

}  // namespace

SqliteDatabase::SqliteDatabase(const std::filesystem::path& file, DiskCalls& calls, Mode mode)
    : file_(std::filesystem::absolute(file).lexically_normal()), vfs_(calls) {
  const int code =
      sqlite3_open_v2(file_.c_str(), &connection_, flags_of(mode), vfs_.name().c_str());
  try {
    if (code != SQLITE_OK) fail();
    sqlite3_extended_result_codes(connection_, 1);
    sqlite3_busy_timeout(connection_, kBusyMs);
    execute(
        "PRAGMA foreign_keys=ON; PRAGMA temp_store=MEMORY; PRAGMA mmap_size=0;"
        "PRAGMA trusted_schema=OFF; PRAGMA cell_size_check=ON; PRAGMA synchronous=FULL;");
    if (mode != Mode::kChange) return;
    SqliteStatement log(*this, "PRAGMA journal_mode=WAL");
    if (!log.step() || log.text(0) != "wal")
      throw maps::StorageError(file_.string(), "its disk does not allow a write-ahead log");
  } catch (...) {
    close();
    throw;
  }
}

SqliteDatabase::SqliteDatabase(Connected, std::filesystem::path file, sqlite3* connection)
    : file_(std::move(file)), vfs_(DiskCalls::real()), connection_(connection) {}

std::unique_ptr<SqliteDatabase> SqliteDatabase::in_memory(const std::filesystem::path& file) {
  const auto connected = [&](const std::string& name, int flags, const char* vfs) {
    sqlite3* connection = nullptr;
    const int code = sqlite3_open_v2(name.c_str(), &connection, flags, vfs);
    std::unique_ptr<SqliteDatabase> database(new SqliteDatabase(Connected{}, file, connection));
    if (code != SQLITE_OK) database->fail();
    return database;
  };
  std::error_code error;
  const bool has_log = std::filesystem::file_size(file.string() + "-wal", error) > 0 && !error;
  // SQLite makes an empty log where there is none, unless told that nothing changes; but then it
  // does not look into one that is there.
  const auto from = connected(uri_of(file) + (has_log ? "" : "?immutable=1"),
                              SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, "unix-none");
  sqlite3_db_config(from->connection_, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  // The index of the log is then kept in memory, not beside the file.
  from->execute("PRAGMA locking_mode=EXCLUSIVE; PRAGMA mmap_size=0;");
  auto memory = connected(":memory:", SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  from->copy_to(*memory);
  memory->execute("PRAGMA foreign_keys=ON; PRAGMA temp_store=MEMORY; PRAGMA trusted_schema=OFF;");
  {
    SqliteStatement check(*memory, "PRAGMA quick_check(1)");
    if (!check.step() || check.text(0) != "ok")
      throw maps::StorageError(file.string(), check.text(0));
  }
  return memory;
}

SqliteDatabase::~SqliteDatabase() { close(); }

void SqliteDatabase::close() { sqlite3_close_v2(std::exchange(connection_, nullptr)); }

void SqliteDatabase::fail() {
  if (connection_ == nullptr) throw maps::StorageError(file_.string(), "no memory");
  std::string reason = sqlite3_errmsg(connection_);
  const int code = sqlite3_errcode(connection_) & 0xff;
  const bool of_disk = code == SQLITE_IOERR || code == SQLITE_FULL || code == SQLITE_CANTOPEN;
  const int changing = vfs_.take_failure();
  const int failure = changing != 0 ? changing : sqlite3_system_errno(connection_);
  if (of_disk && failure != 0) reason += std::string(" (") + std::strerror(failure) + ")";
  // Where the log's index finds no room, SQLite speaks of a failure.
  const bool full = code == SQLITE_FULL || failure == ENOSPC || failure == EDQUOT;
  if (of_disk && full) throw DiskFull(file_.string(), reason);
  if (of_disk || code == SQLITE_READONLY) throw DiskRefused(file_.string(), reason);
  throw maps::StorageError(file_.string(), reason);
}

std::int64_t SqliteDatabase::changes() const { return sqlite3_changes64(connection_); }

std::int64_t SqliteDatabase::inserted() const { return sqlite3_last_insert_rowid(connection_); }

void SqliteDatabase::copy_to(SqliteDatabase& other) {
  sqlite3_backup* copy = sqlite3_backup_init(other.connection_, "main", connection_, "main");
  if (copy == nullptr) other.fail();
  const int code = sqlite3_backup_step(copy, -1);
  const int finished = sqlite3_backup_finish(copy);
  if (finished != SQLITE_OK) other.fail();
  if (code != SQLITE_DONE) throw maps::StorageError(file_.string(), sqlite3_errstr(code));
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

SqliteStatement& SqliteStatement::bind_real(double number) {
  check(sqlite3_bind_double(statement_, ++bound_, number));
  return *this;
}

SqliteStatement& SqliteStatement::bind(const std::optional<std::string>& text) {
  if (text) return bind(std::string_view(*text));
  check(sqlite3_bind_null(statement_, ++bound_));
  return *this;
}

SqliteStatement& SqliteStatement::bind(const std::optional<std::int64_t>& number) {
  if (number) return bind(*number);
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

double SqliteStatement::real(int column) const { return sqlite3_column_double(statement_, column); }

std::optional<std::int64_t> SqliteStatement::optional_integer(int column) const {
  if (sqlite3_column_type(statement_, column) == SQLITE_NULL) return std::nullopt;
  return integer(column);
}

SqliteTransaction::SqliteTransaction(SqliteDatabase& database) : database_(database) {
  if (database.vfs_.sync_failed())
    throw maps::StorageError(
        database.file_.string(),
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

}  // namespace stillmap::server
