#include "voxel_aligner.hpp"

#include "input_checks.hpp"
#include "place_search.hpp"
#include "pose_search.hpp"
#include "query.hpp"
#include "registration.hpp"
#include "verdict.hpp"

#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace stillmap::localization {
namespace {

/// A prior farther than this outside the map's bounds is no place that the map knows [m].
constexpr double kMarginM = 100.0;
/// Fewer points, in the scan or on the surfaces of the map, are no match.
constexpr std::size_t kMinQueryPoints = 50;
constexpr std::size_t kMaxCandidates = 3;
/// Of the whole map more places are looked at closely.
constexpr std::size_t kMaxPlaces = 5;
constexpr double kSearchCellM = 1.0;
/// Share of the best place's support from which a second place makes the answer ambiguous.
constexpr double kAmbiguousShare = 0.9;
constexpr double kDistinctM = 0.5;
constexpr double kDistinctRad = 0.035;
/// Last width of the robust kernel as a share of the finest voxel.
constexpr float kFinalKernelShare = 0.15F;
/// Where the map is bent, what is near decides: a surface at range r was mapped from places up to r
/// away, and GNSS-aided poses of a city drive slid sideways by 0.44 m in 11 m.
constexpr float kBendShare = 0.03F;

struct Place {
  Eigen::Isometry3d T_index_lidar;
  double support = 0.0;
  int iterations = 0;
};

const MapIndex::Level& level_near(const MapIndex& index, double edge_m) {
  return *std::min_element(index.levels().begin(), index.levels().end(),
                           [&](const auto& a, const auto& b) {
                             return std::abs(std::log(static_cast<double>(a.edge_m) / edge_m)) <
                                    std::abs(std::log(static_cast<double>(b.edge_m) / edge_m));
                           });
}

SearchWindow window_of(const Prior& prior) {
  SearchWindow window;
  if (!prior.covariance) return window;
  // A caller who knows where the vehicle is does not want its neighbour street.
  const Matrix6d& covariance = *prior.covariance;
  window.radius_m =
      std::min(window.radius_m, 3.0 * std::sqrt(covariance.diagonal().head<3>().maxCoeff()));
  window.yaw_rad =
      std::min(window.yaw_rad, 3.0 * std::sqrt(covariance.diagonal().tail<3>().maxCoeff()));
  return window;
}

/// Coarse to fine above the finest level, with few points: enough to tell good places from bad.
Place settle(const MapIndex& index, const Query& query, const Eigen::Isometry3d& T_index_lidar) {
  Place place{T_index_lidar};
  const std::size_t stride = std::max<std::size_t>(1, query.points.size() / 1000);
  for (const MapIndex::Level& level : index.levels()) {
    if (&level == &index.levels().back() && index.levels().size() > 1) break;
    place.iterations += refine(level, query.points,
                               {.first_kernel_m = 0.6F * level.edge_m,
                                .last_kernel_m = 0.3F * level.edge_m,
                                .stride = stride,
                                .max_rounds = 4,
                                .bend_share = kBendShare},
                               place.T_index_lidar);
  }
  const Support support = support_of(index, query, place.T_index_lidar, stride);
  place.support = support.standing_ratio * support.known_ratio + 0.1 * support.inlier_ratio;
  return place;
}

/// On the finest level, first by what is near, then by all alike. @return from the second pose to
/// the first one.
Vector6d finish(const MapIndex& index, const Query& query, Place& place) {
  const MapIndex::Level& level = index.levels().back();
  const float middle_kernel_m = 0.3F * level.edge_m;
  place.iterations += refine(level, query.points,
                             {.first_kernel_m = 0.6F * level.edge_m,
                              .last_kernel_m = middle_kernel_m,
                              .max_rounds = 8,
                              .bend_share = kBendShare},
                             place.T_index_lidar);
  const Eigen::Isometry3d T_by_near = place.T_index_lidar;
  place.iterations += refine(level, query.points,
                             {.first_kernel_m = middle_kernel_m,
                              .last_kernel_m = kFinalKernelShare * level.edge_m,
                              .max_rounds = 12},
                             place.T_index_lidar);
  return maps::log_se3(place.T_index_lidar.inverse() * T_by_near);
}

bool distinct(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  const Eigen::Isometry3d difference = a.inverse() * b;
  return difference.translation().norm() > kDistinctM ||
         maps::rotation_angle_rad(difference.linear()) > kDistinctRad;
}

/// Refines each start coarse to fine, finishes the best of them and judges it.
/// @param starts  `T_map_lidar`, at least one. @param prior  may be null.
AlignmentResult align_among(const MapIndex& index, const Query& query,
                            const std::vector<Eigen::Isometry3d>& starts, const Prior* prior) {
  std::vector<Place> places;
  for (const Eigen::Isometry3d& T_map_lidar : starts) {
    Eigen::Isometry3d T_index_lidar = T_map_lidar;
    T_index_lidar.translation() -= index.origin();
    places.push_back(settle(index, query, T_index_lidar));
  }
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.support > b.support; });
  Place& best = places.front();
  const Vector6d bend = finish(index, query, best);

  const MapIndex::Level& level = index.levels().back();
  const float kernel_m = kFinalKernelShare * level.edge_m;
  Evidence evidence;
  evidence.support = support_of(index, query, best.T_index_lidar);
  Matches matches(level, query.points);
  const ResidualRows& rows = matches.at(best.T_index_lidar, kernel_m);
  if (rows.count < kMinQueryPoints) {
    return lost("little_overlap",
                prior != nullptr ? prior->T_map_lidar : Eigen::Isometry3d::Identity());
  }
  const NormalEquations system = linearize(rows, best.T_index_lidar, kernel_m);
  evidence.observability =
      observability_of(level_near(index, kSearchCellM), query, best.T_index_lidar, system.H);
  evidence.ambiguous = std::any_of(places.begin() + 1, places.end(), [&](const Place& other) {
    return other.support > kAmbiguousShare * best.support &&
           distinct(other.T_index_lidar, best.T_index_lidar);
  });
  AlignmentResult result;
  result.T_map_lidar = best.T_index_lidar;
  result.T_map_lidar.translation() += index.origin();
  for (const Place& place : places) result.iterations += place.iterations;
  result.covariance =
      covariance_of(rows, best.T_index_lidar, kernel_m, bend, evidence.observability.degenerate);
  evidence.contradicts_prior = prior != nullptr && contradicts(*prior, result);
  judge(evidence, result.covariance, result);
  return result;
}

}  // namespace

VoxelAligner::VoxelAligner(std::shared_ptr<const MapIndex> index,
                           const std::vector<Eigen::Isometry3d>& seen_from)
    : index_(std::move(index)) {
  if (!index_) throw std::invalid_argument("aligner: no map index");
  for (const Eigen::Isometry3d& T : seen_from) {
    if (!T.matrix().allFinite()) throw std::invalid_argument("seen_from: a pose is not finite");
  }
  if (!seen_from.empty()) places_ = std::make_unique<const PlaceSearch>(*index_, seen_from);
}

VoxelAligner::~VoxelAligner() = default;

AlignmentResult VoxelAligner::align(const maps::PointCloud& scan_lidar,
                                    const std::optional<Prior>& prior) const {
  require_finite(scan_lidar);
  return prior ? align_near(scan_lidar, *prior) : align_anywhere(scan_lidar);
}

AlignmentResult VoxelAligner::align_near(const maps::PointCloud& scan_lidar,
                                         const Prior& prior) const {
  require_usable(prior);
  const Query query = thin(scan_lidar, prior.T_map_lidar.linear());
  if (query.points.size() < kMinQueryPoints) return lost("too_few_points", prior.T_map_lidar);
  const Eigen::Array3d at = (prior.T_map_lidar.translation() - index_->origin()).array();
  if (!((at > -kMarginM).all() && (at < index_->extent().array() + kMarginM).all())) {
    return lost("outside_map", prior.T_map_lidar);
  }
  std::vector<Eigen::Isometry3d> starts;
  for (const Candidate& candidate :
       search_poses(level_near(*index_, kSearchCellM), index_->origin(), query, prior.T_map_lidar,
                    window_of(prior), kMaxCandidates)) {
    starts.push_back(candidate.T_map_lidar);
  }
  return align_among(*index_, query, starts, &prior);
}

AlignmentResult VoxelAligner::align_anywhere(const maps::PointCloud& scan_lidar) const {
  if (!places_) return lost("needs_prior");
  const Query query = thin(scan_lidar, Eigen::Matrix3d::Identity());
  if (query.points.size() < kMinQueryPoints) return lost("too_few_points");
  const std::vector<Eigen::Isometry3d> starts = places_->best_places(query, kMaxPlaces);
  if (starts.empty()) return lost("too_little_structure");
  return align_among(*index_, query, starts, nullptr);
}

}  // namespace stillmap::localization
