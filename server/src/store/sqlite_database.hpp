#pragma once

#include <stillmap/maps/error.hpp>
#include "store/disk_calls.hpp"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "store/sqlite_vfs.hpp"

struct sqlite3;
struct sqlite3_stmt;

namespace stillmap::server {

/// The disk does not let the database be changed: it is read-only or failing (a full one is
/// `DiskFull`). What lies there may still be readable.
class DiskRefused : public maps::StorageError {
 public:
  using maps::StorageError::StorageError;
};

/// One connection, with full syncing. For one thread at a time. Everything throws StorageError with
/// the file and SQLite's reason.
class SqliteDatabase {
 public:
  enum class Mode : std::uint8_t {
    kChange,   ///< opens the file in WAL mode, or makes it
    kRead,     ///< beside one that changes it; waits for no writer
    kNewFile,  ///< for a copy: without a log, so that one file is all there is
  };
  /// @param calls  outlives this.
  SqliteDatabase(const std::filesystem::path& file, DiskCalls& calls, Mode mode = Mode::kChange);
  /// Reads a file into memory without a lock or any change beside it: for a disk that allows
  /// neither. No-one may be writing it, else it may be found broken.
  static std::unique_ptr<SqliteDatabase> in_memory(const std::filesystem::path& file);
  ~SqliteDatabase();
  SqliteDatabase(const SqliteDatabase&) = delete;
  SqliteDatabase& operator=(const SqliteDatabase&) = delete;

  /// Runs statements without parameters or rows.
  void execute(const std::string& sql);
  /// The one integer that a PRAGMA answers.
  [[nodiscard]] std::int64_t pragma(const std::string& name);
  /// Rows that the latest statement changed, and the id of the row that it inserted.
  [[nodiscard]] std::int64_t changes() const;
  [[nodiscard]] std::int64_t inserted() const;
  /// Overwrites another with all that is in this, as of one instant.
  void copy_to(SqliteDatabase& other);
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  /// As those of `SqliteVfs`.
  [[nodiscard]] bool sync_failed() const { return vfs_.sync_failed(); }
  [[nodiscard]] int refused() const { return vfs_.refused(); }
  [[noreturn]] void fail();

 private:
  friend class SqliteStatement;
  friend class SqliteTransaction;
  struct Connected {};
  /// Takes a connection over. @param connection  may be null: no memory.
  SqliteDatabase(Connected, std::filesystem::path file, sqlite3* connection);
  void close();
  std::filesystem::path file_;
  SqliteVfs vfs_;
  sqlite3* connection_ = nullptr;
};

/// One statement with its parameters bound in order from 1.
class SqliteStatement {
 public:
  SqliteStatement(SqliteDatabase& database, std::string_view sql);
  ~SqliteStatement();
  SqliteStatement(const SqliteStatement&) = delete;
  SqliteStatement& operator=(const SqliteStatement&) = delete;

  SqliteStatement& bind(std::string_view text);
  SqliteStatement& bind(const std::string& text) { return bind(std::string_view(text)); }
  SqliteStatement& bind(const char* text) { return bind(std::string_view(text)); }
  SqliteStatement& bind(std::int64_t number);
  SqliteStatement& bind(const std::optional<std::int64_t>& number);
  SqliteStatement& bind(const std::optional<std::string>& text);
  SqliteStatement& bind_real(double number);
  /// @return whether there is a row.
  bool step();
  /// Columns from 0.
  [[nodiscard]] std::string text(int column) const;
  [[nodiscard]] std::optional<std::string> optional_text(int column) const;
  [[nodiscard]] std::int64_t integer(int column) const;
  [[nodiscard]] double real(int column) const;
  [[nodiscard]] std::optional<std::int64_t> optional_integer(int column) const;

 private:
  void check(int code) const;
  SqliteDatabase& database_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
};

/// Takes the write lock; what is not committed is undone. Refused once a sync has failed.
class SqliteTransaction {
 public:
  explicit SqliteTransaction(SqliteDatabase& database);
  ~SqliteTransaction();
  SqliteTransaction(const SqliteTransaction&) = delete;
  SqliteTransaction& operator=(const SqliteTransaction&) = delete;
  void commit();

 private:
  SqliteDatabase& database_;
  bool open_ = true;
};

}  // namespace stillmap::server
