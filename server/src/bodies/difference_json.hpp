#pragma once

#include "catalog/map_views.hpp"

#include <string>

namespace stillmap::server {

/// One that is ready (server/reference.md, "Difference of two versions").
[[nodiscard]] std::string difference_json(const ComparedVersions& pair,
                                          const maps::MapDifference& difference);
/// One that is being made.
[[nodiscard]] std::string difference_progress_json(double progress);

}  // namespace stillmap::server
