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

class SqliteStatement final : public EngineStatement {
 public:
  SqliteStatement(SqliteDatabase& database, sqlite3_stmt* statement)
      : database_(database), statement_(statement) {}
  ~SqliteStatement() override { sqlite3_finalize(statement_); }
  SqliteStatement(const SqliteStatement&) = delete;
  SqliteStatement& operator=(const SqliteStatement&) = delete;

  void bind_text(int parameter, const std::optional<std::string_view>& text) override {
    // An empty text may have no address, which SQLite takes for NULL.
    check(text ? sqlite3_bind_text(statement_, parameter, text->empty() ? "" : text->data(),
                                   static_cast<int>(text->size()), SQLITE_TRANSIENT)
               : sqlite3_bind_null(statement_, parameter));
  }
  void bind_integer(int parameter, const std::optional<std::int64_t>& number) override {
    check(number ? sqlite3_bind_int64(statement_, parameter, *number)
                 : sqlite3_bind_null(statement_, parameter));
  }
  void bind_real(int parameter, double number) override {
    check(sqlite3_bind_double(statement_, parameter, number));
  }
  bool step() override {
    const int code = sqlite3_step(statement_);
    if (code != SQLITE_ROW && code != SQLITE_DONE) database_.fail();
    return code == SQLITE_ROW;
  }
  [[nodiscard]] std::optional<std::string> text(int column) const override {
    const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
    if (text == nullptr) return std::nullopt;
    return std::string(text, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)));
  }
  [[nodiscard]] std::optional<std::int64_t> integer(int column) const override {
    if (sqlite3_column_type(statement_, column) == SQLITE_NULL) return std::nullopt;
    return sqlite3_column_int64(statement_, column);
  }
  [[nodiscard]] double real(int column) const override {
    return sqlite3_column_double(statement_, column);
  }

 private:
  void check(int code) const {
    if (code != SQLITE_OK) database_.fail();
  }
  SqliteDatabase& database_;
  sqlite3_stmt* statement_;
};

}  // namespace

SqliteDatabase::SqliteDatabase(const std::filesystem::path& file, DiskCalls& calls, Mode mode)
    : name_(std::filesystem::absolute(file).lexically_normal().string()), vfs_(calls) {
  const int code =
      sqlite3_open_v2(name_.c_str(), &connection_, flags_of(mode), vfs_.name().c_str());
  try {
    if (code != SQLITE_OK) fail();
    sqlite3_extended_result_codes(connection_, 1);
    sqlite3_busy_timeout(connection_, kBusyMs);
    execute(
        "PRAGMA foreign_keys=ON; PRAGMA temp_store=MEMORY; PRAGMA mmap_size=0;"
        "PRAGMA trusted_schema=OFF; PRAGMA cell_size_check=ON; PRAGMA synchronous=FULL;");
    if (mode != Mode::kChange) return;
    Statement log(*this, "PRAGMA journal_mode=WAL");
    if (!log.step() || log.text(0) != "wal")
      throw maps::StorageError(name_, "its disk does not allow a write-ahead log");
  } catch (...) {
    close();
    throw;
  }
}

SqliteDatabase::SqliteDatabase(Connected, const std::filesystem::path& file, sqlite3* connection)
    : name_(file.string()), vfs_(DiskCalls::real()), connection_(connection) {}

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
    Statement check(*memory, "PRAGMA quick_check(1)");
    if (!check.step() || check.text(0) != "ok")
      throw maps::StorageError(file.string(), check.text(0));
  }
  return memory;
}

SqliteDatabase::~SqliteDatabase() { close(); }

void SqliteDatabase::close() { sqlite3_close_v2(std::exchange(connection_, nullptr)); }

void SqliteDatabase::fail() {
  if (connection_ == nullptr) throw maps::StorageError(name_, "no memory");
  std::string reason = sqlite3_errmsg(connection_);
  const int code = sqlite3_errcode(connection_) & 0xff;
  const bool of_disk = code == SQLITE_IOERR || code == SQLITE_FULL || code == SQLITE_CANTOPEN;
  const int changing = vfs_.take_failure();
  const int failure = changing != 0 ? changing : sqlite3_system_errno(connection_);
  if (of_disk && failure != 0) reason += std::string(" (") + std::strerror(failure) + ")";
  // Where the log's index finds no room, SQLite speaks of a failure.
  const bool full = code == SQLITE_FULL || failure == ENOSPC || failure == EDQUOT;
  if (of_disk && full) throw DiskFull(name_, reason);
  if (of_disk || code == SQLITE_READONLY) throw DiskRefused(name_, reason);
  throw maps::StorageError(name_, reason);
}

std::int64_t SqliteDatabase::changes() const { return sqlite3_changes64(connection_); }

void SqliteDatabase::copy_to(SqliteDatabase& other) {
  sqlite3_backup* copy = sqlite3_backup_init(other.connection_, "main", connection_, "main");
  if (copy == nullptr) other.fail();
  const int code = sqlite3_backup_step(copy, -1);
  const int finished = sqlite3_backup_finish(copy);
  if (finished != SQLITE_OK) other.fail();
  if (code != SQLITE_DONE) throw maps::StorageError(name_, sqlite3_errstr(code));
}

void SqliteDatabase::execute(const std::string& sql) {
  if (sqlite3_exec(connection_, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) fail();
}

std::int64_t SqliteDatabase::pragma(const std::string& name) {
  Statement statement(*this, "PRAGMA " + name);
  return statement.step() ? statement.integer(0) : 0;
}

std::int64_t SqliteDatabase::last_id(std::string_view table) {
  Statement row(*this, "SELECT seq FROM sqlite_sequence WHERE name = ?");
  return row.bind(table).step() ? row.integer(0) : 0;
}

void SqliteDatabase::set_last_id(std::string_view table, std::int64_t id) {
  Statement(*this, "DELETE FROM sqlite_sequence WHERE name = ?").bind(table).step();
  Statement(*this, "INSERT INTO sqlite_sequence (name, seq) VALUES (?, ?)")
      .bind(table)
      .bind(id)
      .step();
}

std::unique_ptr<EngineStatement> SqliteDatabase::prepare(std::string_view sql) {
  sqlite3_stmt* statement = nullptr;
  if (sqlite3_prepare_v2(connection_, sql.data(), static_cast<int>(sql.size()), &statement,
                         nullptr) != SQLITE_OK)
    fail();
  return std::make_unique<SqliteStatement>(*this, statement);
}

void SqliteDatabase::begin_writing() {
  if (vfs_.sync_failed())
    throw maps::StorageError(
        name_, "an earlier sync failed, so nothing more is written; open the store again");
  execute("BEGIN IMMEDIATE");
}

void SqliteDatabase::roll_back() noexcept {
  // A failed commit may have ended it already.
  if (sqlite3_get_autocommit(connection_) == 0)
    sqlite3_exec(connection_, "ROLLBACK", nullptr, nullptr, nullptr);
}

}  // namespace stillmap::server
