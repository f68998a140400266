#include "store/store_database.hpp"

#include <stillmap/maps/store/disk_full.hpp>

#include <system_error>
#include <utility>

#include "store/schema.hpp"

namespace stillmap::maps {

namespace fs = std::filesystem;
using Mode = SqliteDatabase::Mode;

StoreDatabase::StoreDatabase(const fs::path& file, DiskCalls& calls) : file_(file) {
  try {
    open(calls);
  } catch (const DiskRefused& refused) {
    only_read(refused);
  } catch (const DiskFull& full) {
    only_read(full);
  }
}

void StoreDatabase::only_read(const StorageError& because) {
  reader_.reset();
  database_.reset();
  read_only_because_ = because.what();
  try {
    read_into_memory();
  } catch (const StorageError&) {
    // Nothing to be read either: the first reason says more.
    throw StorageError(because);
  }
}

StoreDatabase::StoreDatabase(const fs::path& file, std::string read_only_because)
    : file_(file), read_only_because_(std::move(read_only_because)) {
  read_into_memory();
}

void StoreDatabase::open(DiskCalls& calls) {
  database_ = std::make_unique<SqliteDatabase>(file_, calls);
  migrate(*database_);
  reader_ = std::make_unique<SqliteDatabase>(file_, calls, Mode::kRead);
}

void StoreDatabase::read_into_memory() {
  std::error_code error;
  if (fs::file_size(file_, error) == 0 || error)
    throw StorageError(file_.string(), "nothing there to read");
  database_ = SqliteDatabase::in_memory(file_);
  migrate(*database_);
}

SqliteDatabase& StoreDatabase::writable() {
  if (read_only_because_.empty()) return *database_;
  throw StorageError(file_.string(), "open for reading only: " + read_only_because_);
}

}  // namespace stillmap::maps
