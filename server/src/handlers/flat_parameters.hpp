#pragma once

#include "pose/pose_request.hpp"

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::server {

/// Reads `stamp_ns deadline_ms` and, for raw scans, `layout`; of queries `prior_t prior_q
/// prior_sigma gnss method`, of a session's scans `odom_since_ns odom_t odom_q odom_sigma`.
/// @throws ApiError kUnknownParameter, kInvalidRequest, kInvalidPrior, kInvalidOdometry.
[[nodiscard]] PoseParameters read_flat_parameters(
    const std::vector<std::pair<std::string, std::string>>& query, bool takes_layout,
    ScanPurpose purpose);

/// Name of the parameter that says which vehicle asks. It stands in the query with a body of any
/// type, since the version that is asked depends on it.
inline constexpr std::string_view kVehicleParameter = "vehicle";
/// The label of the vehicle that asks; empty when none is told. @throws ApiError kInvalidRequest.
[[nodiscard]] std::string read_vehicle(
    const std::vector<std::pair<std::string, std::string>>& query);
/// Name of the parameter that says in which set of maps a scan is, in the query for the same
/// reason.
inline constexpr std::string_view kSetParameter = "set";
/// Whether requests for this have it.
[[nodiscard]] constexpr bool has_set(ScanPurpose purpose) {
  return purpose == ScanPurpose::kSetQuery || purpose == ScanPurpose::kSetSealed;
}
/// Empty when none is named. @throws ApiError kInvalidRequest.
[[nodiscard]] std::string read_set(const std::vector<std::pair<std::string, std::string>>& query);
/// For bodies with their parameters inside. @throws ApiError kUnknownParameter for any other
/// parameter than `vehicle`. @param expected  such as "no other query".
void require_vehicle_alone(const std::vector<std::pair<std::string, std::string>>& query,
                           const std::string& expected);

/// `deadline_ms` alone, as far as the head tells it. @throws ApiError kInvalidRequest.
[[nodiscard]] std::optional<std::chrono::milliseconds> read_flat_deadline(
    const std::vector<std::pair<std::string, std::string>>& query);

}  // namespace stillmap::server
