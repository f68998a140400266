#pragma once

#include "store/disk_calls.hpp"
#include "store/disk_full.hpp"

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "store/postgres_database.hpp"
#include "store/sqlite_database.hpp"

namespace stillmap::server {

/// A store's database, in SQLite or PostgreSQL, shared by those who keep a table of it: one
/// connection that changes it, and one that only reads, so that a check of a key never waits for a
/// commit's sync.
class StoreDatabase {
 public:
  /// As the constructors of `StoreState`.
  StoreDatabase(const std::filesystem::path& file, DiskCalls& calls);
  StoreDatabase(const std::filesystem::path& file, std::string read_only_because);
  explicit StoreDatabase(const PostgresAddress& address);

  [[nodiscard]] bool is_sqlite() const { return sqlite_ != nullptr; }
  [[nodiscard]] const std::string& read_only_because() const { return read_only_because_; }

  /// Reads from the connection that changes, so that a caller sees what it did.
  class Reading {
   public:
    explicit Reading(StoreDatabase& owner) : lock_(owner.mutex_), database_(*owner.database_) {}
    [[nodiscard]] Database& database() const { return database_; }

   private:
    std::scoped_lock<std::mutex> lock_;
    Database& database_;
  };

  /// Reads what is committed, beside a writer.
  class ReadingBeside {
   public:
    explicit ReadingBeside(StoreDatabase& owner)
        : lock_(owner.reader_ ? owner.reader_mutex_ : owner.mutex_),
          database_(owner.reader_ ? *owner.reader_ : *owner.database_) {}
    [[nodiscard]] Database& database() const { return database_; }

   private:
    std::scoped_lock<std::mutex> lock_;
    Database& database_;
  };

  /// A transaction; undone unless committed. @throws StorageError when it is open for reading only.
  class Writing {
   public:
    explicit Writing(StoreDatabase& owner)
        : lock_(owner.mutex_), database_(owner.writable()), transaction_(database_) {}
    [[nodiscard]] Database& database() const { return database_; }
    void commit() { transaction_.commit(); }

   private:
    std::scoped_lock<std::mutex> lock_;
    Database& database_;
    Transaction transaction_;
  };

  /// The same, of rows that name packages. @throws also StateAway when this server had the lock of
  /// packages, has lost it, and another one has had it since: that one may have removed what a row
  /// is about, or taken what is to be removed.
  class WritingOfPackages : public Writing {
   public:
    explicit WritingOfPackages(StoreDatabase& owner) : Writing(owner) {
      owner.require_lock_of_packages();
    }
  };

  /// For what removes or revokes: on a full disk the ballast is removed, and it is tried once more.
  /// @param change  has changed nothing when it throws DiskFull.
  template <typename Change>
  auto even_when_full(const Change& change) {
    try {
      return change();
    } catch (const DiskFull&) {
      drop_ballast();
    }
    return change();
  }
  /// Held by who moves packages, between servers that share a state; null for SQLite, whose store
  /// has a lock in its folder. One at a time. It is lost with its connection: see
  /// `WritingOfPackages`.
  [[nodiscard]] std::shared_ptr<void> lock_of_packages();
  /// Another one after every change, as PostgreSQL has told it: known without asking, and the same
  /// while PostgreSQL is away. Nothing for SQLite, which is asked in no time.
  [[nodiscard]] std::optional<std::int64_t> told_mark() const {
    if (!watch_) return std::nullopt;
    return watch_->mark();
  }
  /// Since PostgreSQL answered last; nothing for SQLite.
  [[nodiscard]] std::chrono::duration<double> silence() const {
    if (!watch_) return {};
    return watch_->silence();
  }
  /// Writes all of it into a new file of SQLite's.
  void copy_to(SqliteDatabase& file);
  /// Makes the ballast, a file that holds some room of the disk for `even_when_full`, unless it is
  /// there, or there is no room for it or the disk takes no writes.
  void keep_ballast() const;
  /// Why no change is possible, as far as is known; empty when changes are.
  [[nodiscard]] std::string not_writable_because() const;

 private:
  void open();
  void drop_ballast();
  [[nodiscard]] std::filesystem::path ballast() const;
  void only_read(const maps::StorageError& because);
  void read_into_memory();
  [[nodiscard]] Database& writable();
  void require_lock_of_packages();

  /// Empty for PostgreSQL.
  std::filesystem::path file_;
  std::optional<PostgresAddress> address_;
  DiskCalls* calls_;
  std::string read_only_because_;
  std::mutex mutex_, reader_mutex_;
  mutable std::mutex ballast_mutex_;
  std::unique_ptr<PostgresWatch> watch_;
  std::unique_ptr<Database> database_;
  /// Of the lock of packages, while this has it; else 0.
  std::atomic<std::int64_t> holder_ = 0;
  /// The same; null for PostgreSQL.
  SqliteDatabase* sqlite_ = nullptr;
  /// Closed first: the last one open folds the log into the file, and this one may not. Null where
  /// the database is in memory.
  std::unique_ptr<Database> reader_;
};

}  // namespace stillmap::server
