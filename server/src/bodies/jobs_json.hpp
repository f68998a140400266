#pragma once

#include "jobs/live_jobs.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::server {

[[nodiscard]] std::string job_json(const JobView& view);
/// @param next  what `before` is for the page that follows.
[[nodiscard]] std::string job_list_json(const std::vector<JobView>& jobs,
                                        std::optional<std::int64_t> next);

}  // namespace stillmap::server
