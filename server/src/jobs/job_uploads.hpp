#pragma once

#include "jobs/job_folders.hpp"

#include "store/archive.hpp"
#include "store/package_store.hpp"

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <set>
#include <string>

namespace stillmap::server {

/// Map files that came and wait for the jobs that convert them, named by their SHA-256. Safe from
/// several threads.
class JobUploads {
 public:
  /// Both outlive this.
  JobUploads(PackageStore& store, const JobFolders& folders) : store_(store), folders_(folders) {}

  /// Keeps the bytes of a map file for a job to come, until `release`. @return their SHA-256.
  /// @throws InputError when they are others than was said; StorageError.
  std::string receive(const ByteSource& source, std::uint64_t bytes,
                      const std::optional<std::string>& sha256, const std::string& name);
  /// Once a job that reads it is in the store, or there will be none; then the file goes, as one
  /// that no job reads counts towards no quota.
  void release(const std::string& sha256);
  [[nodiscard]] std::filesystem::path file(const std::string& sha256) const;
  /// Whether so many bytes of a map file may come beside those that wait for their jobs.
  /// @throws StoreRefusal kOverQuota.
  void check_quota(const std::string& map, std::uint64_t bytes) const;

  /// Removes files that no job will read. What comes in right now stays.
  void clear_unused() { clear(/*halves_too=*/false); }
  /// Also what another server was receiving, which is gone.
  void clear_left_by_another() { clear(/*halves_too=*/true); }

 private:
  void clear(bool halves_too);

  PackageStore& store_;
  const JobFolders& folders_;
  /// Held while files change.
  std::mutex mutex_;
  std::uint64_t incoming_ = 0;
  /// Files that are coming, and those that came and whose job is not there yet.
  std::multiset<std::string> held_;
};

/// The file that a conversion reads; empty for other jobs.
[[nodiscard]] std::string sha256_of(const StoredJob& job);

}  // namespace stillmap::server
