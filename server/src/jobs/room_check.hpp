#pragma once

#include "jobs/job_folders.hpp"
#include "jobs/job_request.hpp"
#include "jobs/job_setup.hpp"
#include "jobs/mapper_command.hpp"

#include <chrono>
#include <functional>
#include <stdexcept>
#include <string>

namespace stillmap::server {

/// The mapper was killed, crashed or took too long while it estimated: it may do better when it is
/// tried again.
class ProgramCrash : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Whether a rebuild fits on the disks and into the quota, by what the mapper estimates.
class RoomCheck {
 public:
  /// Both outlive this.
  RoomCheck(const JobSetup& setup, const JobFolders& folders) : setup_(setup), folders_(folders) {}

  /// @param most  that the estimate may take. @param is_unwanted  then it is killed, which is a
  /// ProgramCrash.
  /// @throws ApiError kDiskFull, kNoMapper, kInvalidRequest for what the mapper would refuse;
  /// StoreRefusal kOverQuota, kDiskReserve; ProgramCrash when there is no estimate.
  void check(const std::string& map, const RebuildRequest& request, const RebuildSources& sources,
             std::chrono::seconds most, const std::function<bool()>& is_unwanted) const;

 private:
  void require(const std::filesystem::path& folder, std::uint64_t bytes) const;

  const JobSetup& setup_;
  const JobFolders& folders_;
};

}  // namespace stillmap::server
