#pragma once

#include <stillmap/mapping/odometry_table.hpp>

#include <nlohmann/json.hpp>

namespace stillmap::mapping {

/// A run as it stands in the table and in its piece; NaN is null.
[[nodiscard]] nlohmann::ordered_json run_json(const OdometryTableRun& run);

/// @throws nlohmann::json::exception when a key is absent or of another type.
[[nodiscard]] OdometryTableRun run_of(const nlohmann::ordered_json& json);

}  // namespace stillmap::mapping
