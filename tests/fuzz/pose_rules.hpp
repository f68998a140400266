#pragma once

#include "align/input_checks.hpp"
#include "errors/api_error.hpp"
#include "fuzz_target.hpp"
#include "handlers/scan_in_request.hpp"
#include "pose/pose_checks.hpp"
#include "scan_rules.hpp"

#include <stillmap/localization/movable.hpp>

#include <cmath>

namespace stillmap::fuzz {

/// Limits as a small server has them, so that a fuzzer's inputs reach both sides of each.
[[nodiscard]] inline server::ServerOptions small_options() {
  server::ServerOptions options;
  options.max_payload_bytes = std::size_t{1} << 20U;
  options.max_json_bytes = std::size_t{16} << 10U;
  options.max_scan_points = 1000;
  options.min_scan_points = 2;
  return options;
}

inline void require_rigid(const Eigen::Isometry3d& T) {
  require(T.matrix().allFinite(), "a pose is finite");
  require(T.translation().cwiseAbs().maxCoeff() <= server::kMaxPositionM, "a pose is near enough");
  require((T.linear().transpose() * T.linear()).isIdentity(1e-9), "a rotation is one");
}

/// The bounds of `server/reference.md`; what holds them is taken by the aligner too.
inline void require_bounds(const server::PoseParameters& parameters) {
  if (parameters.prior) {
    require_rigid(parameters.prior->T_map_lidar);
    localization::require_usable(*parameters.prior);
    if (parameters.prior->covariance) {
      const auto sigmas = parameters.prior->covariance->diagonal().array().sqrt();
      // A quotient of 1 + 1e-12 is the rounding of the square root.
      require((sigmas >= 0.999999e-9).all() && (sigmas <= 1.000001e6).all(),
              "a sigma lies in [1e-9, 1e6]");
    }
  }
  if (parameters.T_base_lidar) require_rigid(*parameters.T_base_lidar);
  require(parameters.movable.size() <= server::kMaxMovableBoxes, "no more boxes than allowed");
  if (parameters.deadline) {
    require(
        parameters.deadline->count() >= 1 && parameters.deadline->count() <= server::kMaxDeadlineMs,
        "a deadline lies in its bounds");
  }
}

inline void require_bounds(const server::PoseRequest& request,
                           const server::ServerOptions& options) {
  require_bounds(request.parameters);
  if (const auto* sent = std::get_if<localization::SentScan>(&request.scan_lidar)) {
    for (const Eigen::Vector3f& p : sent->scan.points_lidar.positions)
      require(p.allFinite(), "points are finite");
    require(sent->scan.matched <= sent->scan.points_lidar.size(), "no more matched than sent");
    return;
  }
  const auto* cloud = std::get_if<maps::PointCloud>(&request.scan_lidar);
  const localization::ScanView scan = cloud != nullptr
                                          ? localization::view_of(*cloud)
                                          : std::get<localization::ScanView>(request.scan_lidar);
  const maps::PointCloud points = localization::whole_scan(scan).points_lidar;
  require_whole(points);
  require(points.size() >= options.min_scan_points && points.size() <= options.max_scan_points,
          "as many points as allowed");
  for (const Eigen::Vector3f& p : points.positions)
    require(p.cwiseAbs().maxCoeff() <= server::kMaxPointM, "points are near enough");
  // Refuses with std::invalid_argument, which nobody catches, boxes that should not be here.
  static_cast<void>(localization::without_points_in(points, request.parameters.movable));
}

/// Reads a request with this body and requires its bounds when it is taken.
inline void read_and_require(std::string_view content_type, std::string_view body,
                             std::vector<std::pair<std::string, std::string>> query = {}) {
  static const server::ServerOptions options = small_options();
  server::HttpRequest request;
  request.method = "POST";
  request.headers["content-type"] = content_type;
  request.query = std::move(query);
  request.body = body;
  // A raw scan lies in the request.
  const auto read = taken<server::ApiError>([&] {
    return server::decode_scan(server::find_scan(request, options, server::ScanPurpose::kQuery),
                               options);
  });
  if (read) require_bounds(*read, options);
}

}  // namespace stillmap::fuzz
