#include "store/store_database.hpp"

#include "store/disk_full.hpp"

#include <algorithm>
#include <cstring>
#include <system_error>
#include <utility>

#include "store/durable_files.hpp"
#include "store/schema.hpp"
#include "store/state_copy.hpp"
#include "store/store_folder.hpp"

namespace stillmap::server {

namespace fs = std::filesystem;
using Mode = SqliteDatabase::Mode;

StoreDatabase::StoreDatabase(const fs::path& file, DiskCalls& calls) : file_(file), calls_(&calls) {
  try {
    even_when_full([&] { open(); });
  } catch (const DiskRefused& refused) {
    only_read(refused);
  } catch (const DiskFull& full) {
    only_read(full);
  }
}

void StoreDatabase::only_read(const maps::StorageError& because) {
  reader_.reset();
  sqlite_ = nullptr;
  database_.reset();
  read_only_because_ = because.what();
  try {
    read_into_memory();
  } catch (const maps::StorageError&) {
    // Nothing to be read either: the first reason says more.
    throw maps::StorageError(because);
  }
}

StoreDatabase::StoreDatabase(const fs::path& file, std::string read_only_because)
    : file_(file), calls_(&DiskCalls::real()), read_only_because_(std::move(read_only_because)) {
  read_into_memory();
}

StoreDatabase::StoreDatabase(const PostgresAddress& address)
    : address_(address),
      calls_(&DiskCalls::real()),
      watch_(std::make_unique<PostgresWatch>(address)) {
  auto database = std::make_unique<PostgresDatabase>(address, *watch_);
  migrate(*database);
  database_ = std::move(database);
  reader_ = std::make_unique<PostgresDatabase>(address, *watch_);
}

std::shared_ptr<void> StoreDatabase::lock_of_packages() {
  if (!address_) return nullptr;
  struct Held {
    explicit Held(StoreDatabase& locked)
        : owner(locked), connection(*locked.address_, *locked.watch_) {}
    ~Held() { owner.holder_ = 0; }
    Held(const Held&) = delete;
    Held& operator=(const Held&) = delete;
    StoreDatabase& owner;
    PostgresDatabase connection;
  };
  const auto held = std::make_shared<Held>(*this);
  holder_ = held->connection.lock_packages();
  return held;
}

void StoreDatabase::require_lock_of_packages() {
  if (holder_ == 0 || database_->last_id(PostgresDatabase::kHolderOfPackages) == holder_) return;
  throw StateAway(
      database_->name(),
      "this server has lost the lock of packages, and another one has had it since: ask "
      "again");
}

void StoreDatabase::copy_to(SqliteDatabase& file) {
  const ReadingBeside reading(*this);
  if (sqlite_ != nullptr) {
    // The reading connection is SQLite's, too.
    dynamic_cast<SqliteDatabase&>(reading.database()).copy_to(file);
    return;
  }
  migrate(file);
  copy_state(reading.database(), file);
}

void StoreDatabase::open() {
  auto database = std::make_unique<SqliteDatabase>(file_, *calls_);
  migrate(*database);
  sqlite_ = database.get();
  database_ = std::move(database);
  reader_ = std::make_unique<SqliteDatabase>(file_, *calls_, Mode::kRead);
}

void StoreDatabase::read_into_memory() {
  std::error_code error;
  if (fs::file_size(file_, error) == 0 || error)
    throw maps::StorageError(file_.string(), "nothing there to read");
  auto database = SqliteDatabase::in_memory(file_);
  migrate(*database);
  sqlite_ = database.get();
  database_ = std::move(database);
}

fs::path StoreDatabase::ballast() const { return file_.parent_path() / kBallastName; }

void StoreDatabase::keep_ballast() const {
  if (sqlite_ == nullptr || !read_only_because_.empty()) return;
  // Half made by another thread, it would look like one that a killed process has left.
  const std::scoped_lock one_at_a_time(ballast_mutex_);
  // A removal takes some pages of 4 KiB in the log.
  constexpr std::uintmax_t kUsual = std::uintmax_t{8} << 20U;
  constexpr std::uintmax_t kShareOfDisk = 32;
  std::error_code error;
  const fs::space_info disk = fs::space(file_.parent_path(), error);
  if (error) return;
  const std::uintmax_t wanted = std::min(kUsual, disk.capacity / kShareOfDisk);
  const std::uintmax_t there = fs::file_size(ballast(), error);
  // A process that was killed may have left a shorter one.
  if (!error && there == wanted) return;
  if (error && disk.available < 2 * wanted) return;
  const DurableFiles files(*calls_);
  try {
    if (!error) files.remove_file(ballast());
    DurableFiles::NewFile file = files.create(ballast());
    try {
      file.allocate(wanted);
    } catch (const maps::StorageError&) {
      files.remove_file(ballast());
      throw;
    }
  } catch (const maps::StorageError&) {
    // Another process was first, or the disk has filled up meanwhile: the next call tries again.
  }
}

void StoreDatabase::drop_ballast() {
  if (sqlite_ == nullptr) return;
  try {
    const std::scoped_lock one_at_a_time(ballast_mutex_);
    DurableFiles(*calls_).remove_file(ballast());
  } catch (const maps::StorageError&) {
    // There is none. Emptying the log may be enough.
  }
  const std::scoped_lock lock(mutex_);
  if (!database_) return;
  try {
    database_->execute("PRAGMA wal_checkpoint(TRUNCATE)");
  } catch (const maps::StorageError&) {
    // The change that is tried again says what is wrong.
  }
}

std::string StoreDatabase::not_writable_because() const {
  if (!read_only_because_.empty()) return "it is open for reading only: " + read_only_because_;
  if (watch_) return watch_->is_away() ? "PostgreSQL, which holds its state, is away" : "";
  if (sqlite_->sync_failed()) return "a sync of its disk has failed";
  const int refused = sqlite_->refused();
  return refused == 0 ? ""
                      : std::string("its disk refused the latest one: ") + std::strerror(refused);
}

Database& StoreDatabase::writable() {
  if (read_only_because_.empty()) return *database_;
  throw maps::StorageError(file_.string(), "open for reading only: " + read_only_because_);
}

}  // namespace stillmap::server
