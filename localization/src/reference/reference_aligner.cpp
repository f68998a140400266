#include "reference/reference_aligner.hpp"

#include "align/input_checks.hpp"
#include "align/query.hpp"
#include "reference/evidence.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace stillmap::localization {
namespace {

constexpr std::size_t kFewestPoints = 50;
/// A prior farther than this outside the map's bounds is no place that the map knows [m].
constexpr double kPointsMarginM = 100.0;
/// A method that still takes such steps has some centimetres to go [m].
constexpr double kSettledM = 2e-3;

}  // namespace

ReferenceAligner::ReferenceAligner(std::shared_ptr<const MapPoints> map,
                                   const ReferenceMethod& method)
    : map_(std::move(map)), method_(method) {
  if (!map_) throw std::invalid_argument("aligner: no map points");
}

AlignmentResult ReferenceAligner::align(const maps::PointCloud& scan_lidar,
                                        const std::optional<Prior>& prior) const {
  require_usable(scan_lidar);
  if (!prior) return lost(Reason::kNeedsPrior);
  require_usable(*prior);
  const std::vector<Eigen::Vector3f> points = thinned(scan_lidar.positions, method_.scan_leaf_m);
  if (points.size() < kFewestPoints) return lost(Reason::kTooFewPoints, prior->T_map_lidar);
  Eigen::Isometry3d T_start = prior->T_map_lidar;
  T_start.translation() -= map_->origin();
  if (!map_->within_bounds(T_start.translation(), kPointsMarginM)) {
    return lost(Reason::kOutsideMap, prior->T_map_lidar);
  }
  const Registration registration = method_.align(*map_, points, T_start);
  if (registration.terms.empty()) return lost(Reason::kLittleOverlap, prior->T_map_lidar);

  AlignmentResult result;
  result.T_map_lidar = registration.T_local_lidar;
  result.T_map_lidar.translation() += map_->origin();
  result.iterations = registration.iterations;
  const Uncertainty uncertainty = uncertainty_of(registration.terms, registration.T_local_lidar);
  result.covariance = uncertainty.covariance;
  Evidence evidence;
  evidence.support =
      support_at(*map_, points, standing_flags(points, prior->T_map_lidar.linear().cast<float>()),
                 registration.T_local_lidar);
  evidence.observability.degenerate = uncertainty.degenerate;
  evidence.contradicts_prior = contradicts(*prior, result);
  // These methods take a scan as one instant.
  evidence.not_deskewed =
      std::any_of(scan_lidar.time_offsets_s.begin(), scan_lidar.time_offsets_s.end(),
                  [](float t) { return t != 0.0F; });
  judge(evidence, uncertainty.covariance, VerdictOptions{}, result);
  result.protection = ProtectionLevels{};
  if (result.status != PoseStatus::kLost && !(registration.last_step_m < kSettledM)) {
    result.status = PoseStatus::kDegraded;
    result.reasons.push_back(Reason::kNotConverged);
  }
  return result;
}

}  // namespace stillmap::localization
