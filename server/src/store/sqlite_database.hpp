#pragma once

#include <stillmap/maps/error.hpp>
#include "store/database.hpp"
#include "store/disk_calls.hpp"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "store/sqlite_vfs.hpp"

struct sqlite3;

namespace stillmap::server {

/// The disk does not let the database be changed: it is read-only or failing (a full one is
/// `DiskFull`). What lies there may still be readable.
class DiskRefused : public maps::StorageError {
 public:
  using maps::StorageError::StorageError;
};

/// A connection to SQLite's file, with full syncing.
class SqliteDatabase final : public Database {
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
  ~SqliteDatabase() override;

  [[nodiscard]] const std::string& name() const override { return name_; }
  void execute(const std::string& sql) override;
  [[nodiscard]] std::unique_ptr<EngineStatement> prepare(std::string_view sql) override;
  [[nodiscard]] std::int64_t changes() const override;
  [[nodiscard]] std::int64_t change_mark() override { return pragma("data_version"); }
  [[nodiscard]] std::int64_t last_id(std::string_view table) override;
  void set_last_id(std::string_view table, std::int64_t id) override;
  /// Takes the write lock. Refused once a sync has failed.
  void begin_writing() override;
  void begin_reading() override { execute("BEGIN"); }
  void commit() override { execute("COMMIT"); }
  void roll_back() noexcept override;

  /// The one integer that a PRAGMA answers.
  [[nodiscard]] std::int64_t pragma(const std::string& name);
  /// Overwrites another with all that is in this, as of one instant.
  void copy_to(SqliteDatabase& other);
  /// As those of `SqliteVfs`.
  [[nodiscard]] bool sync_failed() const { return vfs_.sync_failed(); }
  [[nodiscard]] int refused() const { return vfs_.refused(); }
  [[noreturn]] void fail();

 private:
  struct Connected {};
  /// Takes a connection over. @param connection  may be null: no memory.
  SqliteDatabase(Connected, const std::filesystem::path& file, sqlite3* connection);
  void close();
  std::string name_;
  SqliteVfs vfs_;
  sqlite3* connection_ = nullptr;
};

}  // namespace stillmap::server
