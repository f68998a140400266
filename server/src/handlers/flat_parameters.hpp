#pragma once

#include "pose/pose_request.hpp"

#include <chrono>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {

/// Reads `stamp_ns deadline_ms` and, for raw scans, `layout`; of queries `prior_t prior_q
/// prior_sigma gnss method`, of a session's scans `odom_since_ns odom_t odom_q odom_sigma`.
/// @throws ApiError kUnknownParameter, kInvalidRequest, kInvalidPrior, kInvalidOdometry.
[[nodiscard]] PoseParameters read_flat_parameters(
    const std::vector<std::pair<std::string, std::string>>& query, bool takes_layout,
    ScanPurpose purpose);

/// `deadline_ms` alone, as far as the head tells it. @throws ApiError kInvalidRequest.
[[nodiscard]] std::optional<std::chrono::milliseconds> read_flat_deadline(
    const std::vector<std::pair<std::string, std::string>>& query);

}  // namespace stillmap::server
