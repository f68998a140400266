#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>
#include <stillmap/server/server_options.hpp>

#include "http_message.hpp"

#include <Eigen/Geometry>

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::server {

/// Everything a pose request says besides the scan.
struct PoseParameters {
  /// None: the whole map is searched.
  std::optional<localization::Prior> prior;
  std::optional<Eigen::Isometry3d> T_base_lidar;
  /// Objects that may move, found by the caller: points inside are left out of the match.
  std::vector<maps::Box> movable;
  std::optional<std::int64_t> stamp_ns;
  /// Empty = the map's default.
  std::string method;
  std::optional<std::chrono::milliseconds> deadline;
  /// Raw scans: whether a fourth float, the intensity, follows x y z.
  bool has_intensity = true;
};

struct PoseRequest {
  PoseParameters parameters;
  maps::PointCloud scan_lidar;
};

/// Reads a pose request in any of its four content types.
///  - `application/octet-stream`, `application/vnd.pcd`: the body is the scan, the parameters are
///  the query;
///  - `application/json`: both in one object;
///  - `multipart/form-data`: parts `request` (JSON) and `scan`.
/// @throws ApiError for everything that is wrong with it.
[[nodiscard]] PoseRequest read_pose_request(const HttpRequest& request,
                                            const ServerOptions& options);

}  // namespace stillmap::server
