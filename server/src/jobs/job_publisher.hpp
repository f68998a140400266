#pragma once

#include "jobs/job_folders.hpp"
#include "jobs/job_setup.hpp"

#include <cstdint>
#include <mutex>
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

/// Turns the map that an attempt made into a version of the store, and makes it the active one when
/// that was asked for and the gate was passed. While it does, a mark stands in the job's folder, by
/// which the next server knows that this one died of it.
class JobPublisher {
 public:
  /// Both outlive this.
  JobPublisher(const JobSetup& setup, const JobFolders& folders)
      : setup_(setup), folders_(folders) {}

  /// Again after a kill, it comes to the same. The mark stays when this throws.
  /// @param stop  of the server.
  /// @throws StoreRefusal, kNotProcessing when the job is cancelled or the server ends before the
  /// version is there; DiskFull; maps::InputError; maps::StorageError.
  JobOutcome publish(const StoredJob& job, const std::stop_token& stop);
  /// Keeps the outcome of a job whose version was published, and which went no further.
  void keep_outcome(const StoredJob& job, const StoredVersion& version, const std::string& why);

  /// Whether the server that had the job before ended while it published. Counted as a crash, else
  /// a map that is too large for the memory would end every server that follows.
  [[nodiscard]] bool is_marked(std::int64_t job) const;
  void remove_mark(std::int64_t job) const;
  /// Once the server ends: it does not wait for a map that is being loaded, which is no crash.
  void remove_marks(const std::vector<std::int64_t>& jobs);

 private:
  void mark(const JobFolder& folder, const std::stop_token& stop);
  [[nodiscard]] JobOutcome activate(const StoredJob& job, const StoredVersion& version);

  const JobSetup& setup_;
  const JobFolders& folders_;
  /// No mark is made after the server has taken them away.
  std::mutex marks_mutex_;
};

}  // namespace stillmap::server
