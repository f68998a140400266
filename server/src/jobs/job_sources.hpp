#pragma once

#include "jobs/job_folder.hpp"
#include "jobs/job_request.hpp"
#include "jobs/job_setup.hpp"
#include "jobs/mapper_command.hpp"

#include <string>

namespace stillmap::server {

/// What such a rebuild would read now: folders of drives, and the package of the active version.
[[nodiscard]] RebuildSources sources_now(const JobSetup& setup, const std::string& map,
                                         const RebuildRequest& request);
/// The same for a job that is there. It goes on with the active version of when it began, which is
/// kept for it, whatever was activated or removed meanwhile.
[[nodiscard]] RebuildSources sources_of_job(const JobSetup& setup, const std::string& map,
                                            const RebuildRequest& request, const JobFolder& folder);

}  // namespace stillmap::server
