#pragma once

#include "pose_request.hpp"

#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {

/// Reads `prior_t prior_q prior_sigma stamp_ns method deadline_ms` and, for raw scans, `layout`.
/// @throws ApiError kUnknownParameter, kInvalidRequest, kInvalidPrior.
[[nodiscard]] PoseParameters read_flat_parameters(
    const std::vector<std::pair<std::string, std::string>>& query, bool takes_layout);

}  // namespace stillmap::server
