#pragma once

#include <stillmap/mapping/odometry_evaluation.hpp>

#include <nlohmann/json.hpp>

namespace stillmap::mapping {

/// Numbers that are not there (NaN) become null.
[[nodiscard]] nlohmann::ordered_json number_json(double value);

/// `kitti`, `ape_mean_m`, `ate_rmse_m`, `rpe` and what they are made of.
[[nodiscard]] nlohmann::ordered_json errors_json(const TrajectoryErrors& errors);

}  // namespace stillmap::mapping
