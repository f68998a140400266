#pragma once

#include <stillmap/maps/store/disk_calls.hpp>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "store/sqlite_vfs.hpp"

struct sqlite3;
struct sqlite3_stmt;

namespace stillmap::maps {

/// One connection, in WAL mode with full syncing. For one thread at a time. Everything throws
/// StorageError with the file and SQLite's reason.
class SqliteDatabase {
 public:
  /// Opens the file or makes it. @param calls  outlives this.
  SqliteDatabase(std::filesystem::path file, DiskCalls& calls);
  ~SqliteDatabase();
  SqliteDatabase(const SqliteDatabase&) = delete;
  SqliteDatabase& operator=(const SqliteDatabase&) = delete;

  /// Runs statements without parameters or rows.
  void execute(const std::string& sql);
  /// The one integer that a PRAGMA answers.
  [[nodiscard]] std::int64_t pragma(const std::string& name);
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  [[noreturn]] void fail();

 private:
  friend class SqliteStatement;
  friend class SqliteTransaction;
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
  SqliteStatement& bind(std::int64_t number);
  SqliteStatement& bind(const std::optional<std::string>& text);
  /// @return whether there is a row.
  bool step();
  /// Columns from 0.
  [[nodiscard]] std::string text(int column) const;
  [[nodiscard]] std::optional<std::string> optional_text(int column) const;
  [[nodiscard]] std::int64_t integer(int column) const;

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

}  // namespace stillmap::maps
