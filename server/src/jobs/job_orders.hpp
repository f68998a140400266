#pragma once

#include "jobs/job_folders.hpp"
#include "jobs/job_request.hpp"
#include "jobs/job_setup.hpp"
#include "jobs/job_uploads.hpp"
#include "jobs/room_check.hpp"

#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>

namespace stillmap::server {

/// Takes orders for jobs: refuses what could not succeed, and puts the rest into the store's queue.
/// Safe from several threads.
class JobOrders {
 public:
  /// All of it outlives this. @param wake  called when there is a new job.
  JobOrders(const JobSetup& setup, const JobFolders& folders, JobUploads& uploads,
            std::function<void()> wake);

  /// Who asks, and under which name of their own.
  struct Asker {
    std::string key_id;
    std::optional<std::string> idempotency_key;
  };
  /// @throws ApiError kDiskFull, kBusy when too many wait, kInvalidRequest for what the mapper
  /// would refuse, kOtherDigest when the version is there, was removed, or another job makes it;
  /// StoreRefusal as `JobTable::enqueue`, and kOverQuota.
  JobTable::Enqueued rebuild(const std::string& map, const RebuildRequest& request,
                             const Asker& asker);
  /// Of a file that `JobUploads::receive` took. @return the one that is under way for it, or has
  /// made this version of it, when there is one.
  /// @throws ApiError kOtherDigest when the version is there or another file is on its way to it;
  /// StoreRefusal kOverQuota.
  JobTable::Enqueued convert(const std::string& map, const ConvertRequest& request,
                             const Asker& asker);
  /// The newest job that was to convert a file to this version, however it ended.
  [[nodiscard]] std::optional<StoredJob> newest_conversion(const std::string& map,
                                                           const std::string& version) const;

 private:
  void check_waiting() const;
  void check_new_version(const std::string& map, const std::string& version) const;
  void check_free_name(const std::string& map, const std::string& version) const;
  /// @return whether they are in this server's folder.
  [[nodiscard]] bool check_drives(const NewJob& job) const;
  void check_room(const std::string& map, const RebuildRequest& request) const;
  [[nodiscard]] RebuildRequest with_saved_edits(const std::string& map,
                                                RebuildRequest request) const;
  [[nodiscard]] bool is_known_request(const std::string& map, const Asker& asker) const;
  [[nodiscard]] std::optional<StoredJob> converted_before(const std::string& map,
                                                          const ConvertRequest& request) const;
  JobTable::Enqueued enqueue_convert(const std::string& map, const ConvertRequest& request,
                                     const Asker& asker);

  const JobSetup& setup_;
  const JobFolders& folders_;
  JobUploads& uploads_;
  std::function<void()> wake_;
  RoomCheck room_;
  /// Held from the look whether a version is free to the job that makes it.
  std::mutex mutex_;
};

}  // namespace stillmap::server
