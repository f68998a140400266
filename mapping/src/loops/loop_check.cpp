#include "loops/loop_check.hpp"

#include <stillmap/maps/scan.hpp>

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using localization::AlignmentResult;
using localization::PoseStatus;

/// Share of the view that must lie on the map, and how near to it.
constexpr double kLeastInlierRatio = 0.5;
constexpr double kMostRmseM = 0.12;
/// A found pose farther than this from every keyframe of the map is a mere neighbourhood [m].
constexpr double kMostAwayM = 12.0;
/// Of six degrees of freedom one in a million is beyond 38.3.
constexpr double kMostChiSquared = 38.3;

/// The map of a stretch is bent as odometry is on so much of its way [m], which the aligner cannot
/// know: errors of neighbouring keyframes average out in part. Measured on simulated drives with
/// random walks of three sizes added (mapping/loops.md).
constexpr double kBentWayM = 2.5;

/// Loops closer than this along both ways can speak for each other [m].
constexpr double kAgreeingWayM = 30.0;
/// Others that a loop needs: between drives nothing else tells that they are of one town.
constexpr int kSupportWithin = 1;
constexpr int kSupportBetween = 2;

bool is_sure(const AlignmentResult& result) {
  if (result.status == PoseStatus::kLost) return false;
  // A direction that nothing constrains has a large deviation, and both are said.
  const bool open_direction = !result.degenerate_directions.empty();
  return std::all_of(result.reasons.begin(), result.reasons.end(),
                     [&](localization::Reason reason) {
                       return reason == localization::Reason::kUnobservableDirection ||
                              (open_direction && reason == localization::Reason::kLargeCovariance);
                     });
}

/// Of a pose in the map of a stretch, in the query's frame.
Matrix6d covariance_of_bend(const Submap& submap, const Loop& loop, const OdometryPath& path) {
  const Matrix6d per_m = path.covariance_per_m(submap.keyframes.front(), submap.keyframes.back());
  return kBentWayM * carried(loop.T_from_to.inverse(), per_m);
}

bool agree(const Loop& a, const Loop& b, const OdometryPath& path) {
  if (path.way_m(a.from, b.from) > 2.0 * kAgreeingWayM || path.way_m(a.to, b.to) > kAgreeingWayM)
    return false;
  const UncertainMotion through = composed(
      composed(path.motion(a.from, b.from), {b.T_from_to, b.covariance}), path.motion(b.to, a.to));
  return chi_squared({a.T_from_to, a.covariance}, through) < kMostChiSquared;
}

}  // namespace

std::optional<Loop> check_loop(const Proposal& proposal, const std::vector<Eigen::Vector3f>& view,
                               const Submap& submap, const OdometryPath& path) {
  if (!submap.aligner) return std::nullopt;
  maps::PointCloud cloud;
  cloud.positions = view;
  const localization::Prior prior{submap.pose_of(proposal.place) * proposal.T_place_query,
                                  proposal.covariance};
  const AlignmentResult result = submap.aligner->align(cloud, prior);
  if (!is_sure(result)) return std::nullopt;
  if (!(result.inlier_ratio >= kLeastInlierRatio && result.rmse_m <= kMostRmseM))
    return std::nullopt;
  Loop loop;
  loop.from = submap.nearest_to(result.T_map_lidar.translation());
  loop.to = proposal.query;
  loop.T_from_to = submap.pose_of(loop.from).inverse() * result.T_map_lidar;
  if (!(loop.T_from_to.translation().norm() < kMostAwayM)) return std::nullopt;
  loop.covariance = result.covariance + covariance_of_bend(submap, loop, path);
  loop.inlier_ratio = result.inlier_ratio;
  loop.rmse_m = result.rmse_m;
  if (path.drive(loop.from) == path.drive(loop.to) &&
      !(chi_squared(path.motion(loop.from, loop.to), {loop.T_from_to, loop.covariance}) <
        kMostChiSquared))
    return std::nullopt;
  return loop;
}

std::vector<char> agreed_loops(const std::vector<Loop>& loops, const OdometryPath& path) {
  std::vector<char> agreed;
  agreed.reserve(loops.size());
  for (const Loop& loop : loops) {
    const auto support = std::count_if(loops.begin(), loops.end(), [&](const Loop& other) {
      return other.to != loop.to && agree(loop, other, path);
    });
    const bool within = path.drive(loop.from) == path.drive(loop.to);
    agreed.push_back(support >= (within ? kSupportWithin : kSupportBetween) ? 1 : 0);
  }
  return agreed;
}

}  // namespace stillmap::mapping
