#pragma once

#include "errors/error_codes.hpp"
#include "pose/gnss_prior.hpp"
#include "pose/pose_request.hpp"

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>
#include <stillmap/server/server_options.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace stillmap::server {

/// Farthest a map position may be from the origin [m]; beyond it voxel numbers no longer fit.
inline constexpr double kMaxPositionM = 1e8;
/// Farthest a scan's point may be from the sensor [m].
inline constexpr float kMaxPointM = 1e5F;
/// Farthest a point's time may be from the scan's stamp [s].
inline constexpr float kMaxPointTimeS = 1.0F;
/// How far a quaternion's norm may be from 1.
inline constexpr double kQuaternionTolerance = 1e-3;
/// Least and largest deviation of a prior [m, rad]: below a nanometre the squares leave the range
/// in which a matrix can be inverted.
inline constexpr double kMinSigma = 1e-9;
inline constexpr double kMaxSigma = 1e6;
/// Most boxes of movable objects that a request may send.
inline constexpr std::size_t kMaxMovableBoxes = 500;
/// Longest deadline of a request [ms].
inline constexpr std::int64_t kMaxDeadlineMs = 600'000;

/// What a pose belongs to, for messages.
struct PoseField {
  ErrorCode code;
  std::string position_path;
  std::string quaternion_path;
};

/// @param quaternion  x y z w. @throws ApiError with the field's code when not finite, too far or
/// not of unit norm.
[[nodiscard]] Eigen::Isometry3d checked_pose(const std::array<double, 3>& position,
                                             const std::array<double, 4>& quaternion,
                                             const PoseField& field);

/// A covariance, made symmetric where it is so but for the digits of 32-bit floats.
/// @param values  36, row by row. @throws ApiError with the code unless symmetric, positive
/// definite, and of deviations in [kMinSigma, kMaxSigma].
[[nodiscard]] Eigen::Matrix<double, 6, 6> checked_covariance(std::span<const double, 36> values,
                                                             const std::string& path,
                                                             ErrorCode code);

/// The same of a prior, whose rows of zeros mean "not told", as planar localizers write z, roll and
/// pitch: they get the deviation of which the search around a prior without covariance is three
/// times.
[[nodiscard]] Eigen::Matrix<double, 6, 6> checked_prior_covariance(
    std::span<const double, 36> values, const std::string& path);

/// The same of a step of odometry, of which wheels tell no z, roll and pitch: rows of zeros get 0.1
/// m and a tenth of the step's length [m], or 0.05 rad.
[[nodiscard]] Eigen::Matrix<double, 6, 6> checked_odometry_covariance(
    std::span<const double, 36> values, double step_m, const std::string& path);

/// @throws ApiError kInvalidPrior for a place that is not on Earth or a deviation out of its
/// bounds.
void check_gnss(const GnssFix& fix, const std::string& path);

/// A box in the lidar frame. @param path  of the box, for messages. @throws ApiError kInvalidBoxes
/// for a value that is not finite or beyond what `localization::without_points_in` takes.
[[nodiscard]] maps::Box checked_box(const std::array<double, 3>& centre,
                                    const std::array<double, 3>& size, double yaw_rad,
                                    const std::string& path);

/// @throws ApiError kInvalidRequest outside [1, kMaxDeadlineMs].
[[nodiscard]] std::chrono::milliseconds checked_deadline(std::int64_t deadline_ms);

/// Of a vehicle: 1 to 64 of printable ASCII. It is shown to people, and stands in no log.
constexpr const char* kLabelRule = "1 to 64 of printable ASCII";
[[nodiscard]] bool is_label(std::string_view text);

/// Decimal int64. @throws ApiError kInvalidRequest.
[[nodiscard]] std::int64_t read_integer(const std::string& path, std::string_view text);

/// `xyz`, `xyzi` or `xyzit`. @throws ApiError kInvalidRequest.
[[nodiscard]] maps::ScanFormat raw_format_of(const std::string& layout);

/// Also sets `no_returns` of raw and thinned scans.
/// @throws ApiError kPayloadTooLarge, kTooFewPoints, or kInvalidPoints for a point that is too far
/// or a time too far from the stamp.
void check_scan(PoseRequest& request, const ServerOptions& options);

}  // namespace stillmap::server
