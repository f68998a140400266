#pragma once

#include "store/disk_calls.hpp"

#include <atomic>
#include <memory>
#include <string>

namespace stillmap::server {

/// SQLite's own file system layer for Unix, but every lasting change passes `DiskCalls` first, and
/// creating or removing a file is followed by a sync of its folder: a removed journal that comes
/// back after a power cut would undo what was committed. Locks, reads and the shared index
/// of the log are SQLite's own.
class SqliteVfs {
 public:
  /// Registers it under a name of its own. @param calls  outlives this.
  explicit SqliteVfs(DiskCalls& calls);
  /// No connection may be open any more.
  ~SqliteVfs();
  SqliteVfs(const SqliteVfs&) = delete;
  SqliteVfs& operator=(const SqliteVfs&) = delete;

  [[nodiscard]] const std::string& name() const { return name_; }
  /// Whether a sync has ever failed: what lies on the disk is not known any more.
  [[nodiscard]] bool sync_failed() const { return sync_failed_; }
  /// The errno of the latest change that failed but for want of room, until one is synced again; 0
  /// = none did. A disk that has become read-only says so here.
  [[nodiscard]] int refused() const { return refused_; }
  /// The errno of the latest change that failed, told once; 0 = none failed.
  int take_failure() { return failure_.exchange(0); }

 private:
  struct Methods;
  struct Registration;
  DiskCalls& calls_;
  std::string name_;
  std::unique_ptr<Registration> registration_;
  std::atomic<bool> sync_failed_{false};
  std::atomic<int> failure_{0}, refused_{0};
};

}  // namespace stillmap::server
