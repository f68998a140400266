#pragma once

#include "pose_request.hpp"

#include <string_view>

namespace stillmap::server {

/// Where the scan of a JSON request stands, and so which keys it may have.
enum class JsonScan {
  kInside,     ///< key `points`
  kRawBeside,  ///< in another part as floats: key `layout`
  kPcdBeside,  ///< in another part, describes itself
};

struct JsonPoseRequest {
  PoseParameters parameters;
  /// Filled with `JsonScan::kInside`.
  maps::PointCloud scan_lidar;
};

/// Reads `prior {position, quaternion, covariance}`, `T_base_lidar {position, quaternion}`,
/// `movable [{centre, size, yaw}]`, `stamp_ns`, `method`, `deadline_ms` and `points` or `layout`.
/// @throws ApiError with the path of what is wrong; unknown keys are refused.
[[nodiscard]] JsonPoseRequest read_pose_request_json(std::string_view text, JsonScan scan,
                                                     const ServerOptions& options);

}  // namespace stillmap::server
