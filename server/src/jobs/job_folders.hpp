#pragma once

#include "jobs/job_folder.hpp"

#include <stillmap/server/server_options.hpp>
#include "store/package_store.hpp"

#include <cstdint>
#include <filesystem>
#include <string>

namespace stillmap::server {

/// Where jobs work: a folder for each, and one for the files that wait for their jobs. It is "jobs"
/// in the store's folder, or where the options say.
class JobFolders {
 public:
  /// @param store  outlives this.
  JobFolders(const JobOptions& options, PackageStore& store);

  [[nodiscard]] const std::filesystem::path& root() const { return root_; }
  /// Of the store, also when jobs work elsewhere: whoever locks it does this store's jobs.
  [[nodiscard]] std::filesystem::path of_store() const;
  [[nodiscard]] std::filesystem::path uploads() const { return root_ / "uploads"; }
  [[nodiscard]] JobFolder of(std::int64_t id) const { return {root_ / std::to_string(id)}; }
  /// By which the state knows the server that works here, also after its restart.
  [[nodiscard]] std::string server() const { return name_server_of(root_); }
  /// By which it knows in whose folder drives and uploads of versions are.
  [[nodiscard]] std::string server_of_drives() const { return name_server_of(of_store()); }
  /// Whether files are here that are in the folder of this server, or anywhere. Of a state that is
  /// not shared they are.
  [[nodiscard]] bool has_files_of(const std::string& server) const;
  /// A message for clients, who need not know where on this machine the store and the jobs are.
  [[nodiscard]] std::string without_places(std::string text) const;
  /// Removes what a job has made but its log. What it left in a cluster is cancelled first; if that
  /// cannot be done now, all stays for `clear_forgotten`.
  void clear_work(const JobFolder& job) const;
  /// Removes the folders of jobs that the store does not know any more, and what finished ones
  /// left of their work.
  void clear_forgotten() const;

 private:
  PackageStore& store_;
  std::filesystem::path root_;
};

}  // namespace stillmap::server
