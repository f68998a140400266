#include "pose/pose_checks.hpp"

#include "errors/api_error.hpp"

#include <stillmap/localization/movable.hpp>
#include <stillmap/localization/options.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <cmath>
#include <optional>

namespace stillmap::server {

Eigen::Isometry3d checked_pose(const std::array<double, 3>& position,
                               const std::array<double, 4>& quaternion, const PoseField& field) {
  const Eigen::Vector3d t(position[0], position[1], position[2]);
  if (!(t.cwiseAbs().maxCoeff() <= kMaxPositionM) || t.hasNaN()) {
    throw field_error(field.code, field.position_path, fmt::format("{}", fmt::join(position, ", ")),
                      fmt::format("three finite numbers within {} m", kMaxPositionM));
  }
  const Eigen::Quaterniond q(quaternion[3], quaternion[0], quaternion[1], quaternion[2]);
  if (!(std::abs(q.norm() - 1.0) <= kQuaternionTolerance)) {
    throw field_error(field.code, field.quaternion_path,
                      fmt::format("{} with norm {}", fmt::join(quaternion, ", "), q.norm()),
                      fmt::format("x, y, z, w with norm 1 within {}{}", kQuaternionTolerance,
                                  q.norm() == 0.0 ? "; send 0, 0, 0, 1 for no turn" : ""));
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = t;
  T.linear() = q.normalized().toRotationMatrix();
  return T;
}

namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;

constexpr std::array kRowNames{"tx", "ty", "tz", "rx", "ry", "rz"};

/// What keeps a finite matrix from being a covariance.
std::string fault_of(const Matrix6& covariance) {
  // What 32-bit floats leave of a symmetry.
  constexpr double kSymmetryTolerance = 1e-6;
  const Matrix6 difference = (covariance - covariance.transpose()).cwiseAbs();
  Eigen::Index row = 0, column = 0;
  if (difference.maxCoeff(&row, &column) > kSymmetryTolerance * covariance.cwiseAbs().maxCoeff())
    return fmt::format("a matrix that is not symmetric: row {}, column {} is {}, the other way {}",
                       row, column, covariance(row, column), covariance(column, row));
  for (Eigen::Index i = 0; i < 6; ++i)
    if (covariance(i, i) <= 0.0)
      return fmt::format(
          "a matrix that is not positive definite: the variance of {} (row {}) is {}",
          kRowNames.at(static_cast<std::size_t>(i)), i, covariance(i, i));
  const std::optional<Matrix6> factor = maps::cholesky(covariance);
  // A NaN on the way, of an overflow, passes for success.
  if (!factor || !factor->allFinite()) return "a matrix that is not positive definite";
  return {};
}

/// Rows and columns of zeros get these deviations.
RowMajor6 with_not_told(std::span<const double, 36> values, double sigma_m, double sigma_rad) {
  const RowMajor6 given = Eigen::Map<const RowMajor6>(values.data());
  RowMajor6 filled = given;
  for (Eigen::Index i = 0; i < 6; ++i) {
    if (!given.row(i).isZero(0.0) || !given.col(i).isZero(0.0)) continue;
    filled(i, i) = std::pow(i < 3 ? sigma_m : sigma_rad, 2);
  }
  return filled;
}

}  // namespace

Matrix6 checked_covariance(std::span<const double, 36> values, const std::string& path,
                           ErrorCode code) {
  const Matrix6 given = Eigen::Map<const RowMajor6>(values.data());
  if (!given.allFinite()) {
    throw field_error(code, path, "a number that is not finite", "36 finite numbers");
  }
  if (const std::string fault = fault_of(given); !fault.empty())
    throw field_error(code, path, fault,
                      "a symmetric positive definite 6 x 6 matrix, row by row, both triangles "
                      "filled");
  Matrix6 covariance = 0.5 * (given + given.transpose());
  const auto variances = covariance.diagonal().array();
  if (!(variances >= kMinSigma * kMinSigma && variances <= kMaxSigma * kMaxSigma).all()) {
    throw field_error(
        code, path,
        fmt::format("variances from {} to {}", variances.minCoeff(), variances.maxCoeff()),
        fmt::format("deviations in [{}, {}] m or rad", kMinSigma, kMaxSigma));
  }
  return covariance;
}

Matrix6 checked_prior_covariance(std::span<const double, 36> values, const std::string& path) {
  const localization::AlignerOptions search;
  const RowMajor6 filled =
      with_not_told(values, search.search_radius_m / 3.0, search.search_yaw_rad / 3.0);
  return checked_covariance(std::span<const double, 36>(filled.data(), 36), path,
                            ErrorCode::kInvalidPrior);
}

Matrix6 checked_odometry_covariance(std::span<const double, 36> values, double step_m,
                                    const std::string& path) {
  // How far a road rises or tilts beside what wheels see of it.
  constexpr double kLeastM = 0.1, kShareOfStep = 0.1, kTiltRad = 0.05;
  const RowMajor6 filled = with_not_told(values, kLeastM + kShareOfStep * step_m, kTiltRad);
  return checked_covariance(std::span<const double, 36>(filled.data(), 36), path,
                            ErrorCode::kInvalidOdometry);
}

void check_gnss(const GnssFix& fix, const std::string& path) {
  // Written so that a NaN anywhere is refused.
  const bool on_earth = std::abs(fix.latitude_deg) <= 90.0 && std::abs(fix.longitude_deg) <= 180.0;
  const bool height = !fix.altitude_m || std::abs(*fix.altitude_m) <= 1e4;
  if (!on_earth || !height) {
    throw field_error(ErrorCode::kInvalidPrior, path,
                      fmt::format("{}, {}, {}", fix.latitude_deg, fix.longitude_deg,
                                  fix.altitude_m.value_or(0.0)),
                      "latitude within 90, longitude within 180 degrees, altitude within 10000 m");
  }
  if (!(fix.sigma_m >= kMinGnssSigmaM && fix.sigma_m <= kMaxGnssSigmaM)) {
    throw field_error(ErrorCode::kInvalidPrior, path + " sigma_m", fmt::format("{}", fix.sigma_m),
                      fmt::format("{} to {} m", kMinGnssSigmaM, kMaxGnssSigmaM));
  }
}

maps::Box checked_box(const std::array<double, 3>& centre, const std::array<double, 3>& size,
                      double yaw_rad, const std::string& path) {
  const auto refuse = [&](const char* key, const std::string& found, const std::string& expected) {
    throw field_error(ErrorCode::kInvalidBoxes, path + key, found, expected);
  };
  maps::Box box;
  box.centre = Eigen::Vector3d(centre[0], centre[1], centre[2]);
  box.size_m = Eigen::Vector3d(size[0], size[1], size[2]);
  box.yaw_rad = yaw_rad;
  // Written so that a NaN anywhere is refused.
  if (!(box.centre.array().abs() <= localization::kMaxBoxCentreM).all()) {
    refuse(".centre", fmt::format("{}", fmt::join(centre, ", ")),
           fmt::format("three numbers within {} m", localization::kMaxBoxCentreM));
  }
  if (!(box.size_m.array() > 0.0 && box.size_m.array() <= localization::kMaxBoxEdgeM).all()) {
    refuse(
        ".size", fmt::format("{}", fmt::join(size, ", ")),
        fmt::format("length, width and height above 0 and up to {} m", localization::kMaxBoxEdgeM));
  }
  if (!std::isfinite(yaw_rad)) refuse(".yaw", fmt::format("{}", yaw_rad), "a finite number");
  return box;
}

std::chrono::milliseconds checked_deadline(std::int64_t deadline_ms) {
  if (deadline_ms < 1 || deadline_ms > kMaxDeadlineMs) {
    throw field_error(ErrorCode::kInvalidRequest, "deadline_ms", std::to_string(deadline_ms),
                      fmt::format("1 to {}", kMaxDeadlineMs));
  }
  return std::chrono::milliseconds(deadline_ms);
}

bool is_label(std::string_view text) {
  constexpr std::size_t kMostBytes = 64;
  return !text.empty() && text.size() <= kMostBytes &&
         std::all_of(text.begin(), text.end(),
                     [](char byte) { return byte >= ' ' && byte <= '~'; });
}

std::int64_t read_integer(const std::string& path, std::string_view text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) {
    throw field_error(ErrorCode::kInvalidRequest, path, "'" + std::string(text) + "'",
                      "a decimal 64-bit integer");
  }
  return value;
}

maps::ScanFormat raw_format_of(const std::string& layout) {
  if (layout == "xyz") return maps::ScanFormat::kBinXyz;
  if (layout == "xyzi") return maps::ScanFormat::kBinXyzi;
  if (layout == "xyzit") return maps::ScanFormat::kBinXyzit;
  throw field_error(ErrorCode::kInvalidRequest, "layout", "'" + layout + "'", "xyz, xyzi or xyzit");
}

namespace {

void check_count(std::size_t points, const ServerOptions& options) {
  if (points > options.max_scan_points) {
    throw field_error(ErrorCode::kPayloadTooLarge, "scan", fmt::format("{} points", points),
                      fmt::format("at most {}", options.max_scan_points));
  }
  if (points < options.min_scan_points) {
    throw field_error(ErrorCode::kTooFewPoints, "scan", fmt::format("{} usable points", points),
                      fmt::format("at least {}", options.min_scan_points));
  }
}

bool is_near(float x, float y, float z) {
  return std::abs(x) <= kMaxPointM && std::abs(y) <= kMaxPointM && std::abs(z) <= kMaxPointM;
}

ApiError invalid_point(std::size_t i, const std::string& found, const std::string& expected) {
  return field_error(ErrorCode::kInvalidPoints, fmt::format("scan point {}", i), found, expected);
}

/// @throws ApiError for the first point that is wrong.
void check_points(const localization::ScanView& scan) {
  // Without branches first: nearly all scans are right.
  bool right = true;
  for (std::size_t i = 0; i < scan.size; ++i) {
    const auto [x, y, z] = scan.point(i);
    right &= is_near(x, y, z) && std::abs(scan.time(i)) <= kMaxPointTimeS;
  }
  if (right) return;
  for (std::size_t i = 0; i < scan.size; ++i) {
    if (!scan.is_point(i)) continue;
    const auto [x, y, z] = scan.point(i);
    if (!is_near(x, y, z))
      throw invalid_point(i, fmt::format("{}, {}, {}", x, y, z),
                          fmt::format("coordinates within {} m", kMaxPointM));
    if (!(std::abs(scan.time(i)) <= kMaxPointTimeS))
      throw invalid_point(i, fmt::format("{} s", scan.time(i)),
                          fmt::format("within {} s of the scan's stamp", kMaxPointTimeS));
  }
}

}  // namespace

void check_scan(PoseRequest& request, const ServerOptions& options) {
  if (const auto* sent = std::get_if<localization::SentScan>(&request.scan_lidar)) {
    request.no_returns = sent->no_returns;
    check_count(sent->points, options);
    return;
  }
  if (const auto* cloud = std::get_if<maps::PointCloud>(&request.scan_lidar)) {
    check_count(cloud->size(), options);
    check_points(localization::view_of(*cloud));
    return;
  }
  const auto& raw = std::get<localization::ScanView>(request.scan_lidar);
  request.no_returns = localization::count_points(raw, 0.0).no_returns;
  check_count(raw.size - request.no_returns, options);
  check_points(raw);
}

}  // namespace stillmap::server
