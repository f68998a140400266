#pragma once

#include "jobs/job_folders.hpp"
#include "jobs/job_setup.hpp"

#include <stop_token>
#include <string>
#include <vector>

namespace stillmap::server {

/// What a job that succeeded came to.
struct JobOutcome {
  std::string version{};
  std::string digest{};
  bool activated = false;
  /// Why it was asked for and not done.
  std::vector<std::string> not_activated_because{};
  /// What the gate found, as the mapper's report has it; empty for a job without a gate.
  std::string gate{};
};

[[nodiscard]] std::string to_json(const JobOutcome& outcome);

/// Turns the map that an attempt made into a version of the store, and makes it the active one when
/// that was asked for and the gate was passed.
class JobPublisher {
 public:
  /// Both outlive this.
  JobPublisher(const JobSetup& setup, const JobFolders& folders)
      : setup_(setup), folders_(folders) {}

  /// Again after a kill, it comes to the same.
  /// @param stop  of the server.
  /// @throws StoreRefusal, kNotProcessing when the job is cancelled or the server ends before the
  /// version is there; DiskFull; maps::InputError; maps::StorageError.
  JobOutcome publish(const StoredJob& job, const std::stop_token& stop);
  /// Of a job whose version was published, and which went no further.
  [[nodiscard]] JobOutcome outcome_without_more(const StoredJob& job, const StoredVersion& version,
                                                const std::string& why) const;

 private:
  [[nodiscard]] JobOutcome activate(const StoredJob& job, const StoredVersion& version);

  const JobSetup& setup_;
  const JobFolders& folders_;
};

}  // namespace stillmap::server
