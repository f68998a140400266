#pragma once

#include "errors/api_error.hpp"
#include "pose/pose_request.hpp"

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

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

/// Reads `prior {position, quaternion, covariance}`, `gnss {latitude_deg, longitude_deg,
/// altitude_m?, sigma_m}`, `T_base_lidar {position, quaternion}`, `movable [{centre, size, yaw}]`,
/// `stamp_ns`, `method`, `deadline_ms`, `odometry {since_ns, position, quaternion, covariance}` and
/// `points` or `layout`, as far as the purpose has them.
/// @param require_wanted  as in `JsonBounds`.
/// @throws ApiError with the path of what is wrong; unknown keys are refused.
[[nodiscard]] JsonPoseRequest read_pose_request_json(std::string_view text, JsonScan scan,
                                                     ScanPurpose purpose,
                                                     const ServerOptions& options,
                                                     std::function<void()> require_wanted = {});

struct JsonBatch {
  std::optional<std::chrono::milliseconds> deadline;
  /// One a query: what it says, or the error that it alone is answered with.
  struct Item {
    JsonPoseRequest request;
    std::optional<ApiError> error;
  };
  std::vector<Item> items;
};

/// Reads `queries [...]`, each as above, and `deadline_ms`.
/// @throws ApiError for the whole; what is wrong with one query stays with it.
[[nodiscard]] JsonBatch read_batch_json(std::string_view text, JsonScan scan,
                                        const ServerOptions& options,
                                        std::function<void()> require_wanted = {});

/// What a session is opened with: `map`, `version?`, or `set`, or neither where there is one set;
/// and `prior` (with covariance) or `gnss`.
struct SessionRequest {
  std::string map;
  std::string set;
  std::string version;
  /// What operators call the vehicle; empty when the client does not say.
  std::string label;
  std::optional<localization::Prior> prior;
  std::optional<GnssFix> gnss;
};

/// @param opens  whether `map`, `version`, `set` and `label` are read; else only where the vehicle
/// is.
/// @throws ApiError with the path of what is wrong; unknown keys are refused.
[[nodiscard]] SessionRequest read_session_json(std::string_view text, bool opens,
                                               const ServerOptions& options);

}  // namespace stillmap::server
