#include "input_checks.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include "align/pose_pdf.hpp"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

namespace stillmap::localization {
namespace {

/// As for sessions: what products of matrices leave of a symmetry.
constexpr double kSymmetryTolerance = 1e-6;
/// Readers take no times beyond a second; a sweep takes 0.05 to 0.2 s.
constexpr float kMaxTimeOffsetS = 10.0F;

bool all_finite(std::span<const Eigen::Vector3f> points) {
  if (points.empty()) return true;
  static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float));
  // All bits of the exponent are set in a number that is not finite. The compiler takes several
  // integers at once.
  constexpr std::uint32_t kExponent = 0x7F800000;
  std::uint32_t others = 0;
  for (const float number : std::span(points.front().data(), 3 * points.size()))
    others |= (std::bit_cast<std::uint32_t>(number) & kExponent) == kExponent ? 1U : 0U;
  return others == 0;
}

}  // namespace

void require_usable(const maps::PointCloud& scan_lidar) {
  const std::vector<float>& times = scan_lidar.time_offsets_s;
  if (!times.empty() && times.size() != scan_lidar.size()) {
    throw std::invalid_argument(
        fmt::format("scan: found {} times, expected none or {}", times.size(), scan_lidar.size()));
  }
  for (const float t : times) {
    if (!(std::abs(t) <= kMaxTimeOffsetS)) {
      throw std::invalid_argument(fmt::format(
          "scan: found a time of {} s, expected within {} s of the stamp", t, kMaxTimeOffsetS));
    }
  }
  if (!all_finite(scan_lidar.positions))
    throw std::invalid_argument("scan: a coordinate is not finite");
}

void require_usable(const ThinScan& scan_lidar, const AlignerOptions& options) {
  require_usable(scan_lidar.points_lidar);
  if (scan_lidar.matched > scan_lidar.points_lidar.size())
    throw std::invalid_argument(fmt::format("scan: found {} matched points of {}",
                                            scan_lidar.matched, scan_lidar.points_lidar.size()));
  if (scan_lidar.own_vehicle_m != static_cast<float>(options.own_vehicle_m))
    throw std::invalid_argument(
        fmt::format("scan: thinned with own_vehicle_m {}, expected {}: thin it with that",
                    scan_lidar.own_vehicle_m, static_cast<float>(options.own_vehicle_m)));
}

void require_usable(const Prior& prior) {
  if (!prior.T_map_lidar.matrix().allFinite()) throw std::invalid_argument("prior: not finite");
  const Eigen::Matrix3d& R = prior.T_map_lidar.linear();
  if (!((R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-3 &&
        R.determinant() > 0.0)) {
    throw std::invalid_argument("prior: its rotation matrix is not a rotation");
  }
  if (prior.covariance) {
    const Matrix6d& covariance = *prior.covariance;
    const bool symmetric =
        covariance.allFinite() && (covariance - covariance.transpose()).cwiseAbs().maxCoeff() <=
                                      kSymmetryTolerance * covariance.cwiseAbs().maxCoeff();
    // The decomposition looks at one triangle alone.
    if (!symmetric || !is_positive_definite(covariance)) {
      throw std::invalid_argument(
          "prior: its covariance is not finite, symmetric and positive definite");
    }
  }
}

bool is_positive_definite(const Eigen::Matrix<double, 6, 6>& covariance) {
  const std::optional<Matrix6d> factor = maps::cholesky(covariance);
  return factor && factor->allFinite() && covariance.allFinite();
}

bool contradicts(const Prior& prior, const AlignmentResult& result) {
  if (!prior.covariance) return false;
  const double squares =
      chi_squared({prior.T_map_lidar, *prior.covariance}, {result.T_map_lidar, result.covariance});
  return !(squares < kMaxChiSquared);
}

AlignmentResult lost(Reason reason, const Eigen::Isometry3d& T_map_lidar) {
  AlignmentResult result;
  result.reasons.push_back(reason);
  result.T_map_lidar = T_map_lidar;
  return result;
}

}  // namespace stillmap::localization
