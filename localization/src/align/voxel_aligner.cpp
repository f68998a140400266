#include "voxel_aligner.hpp"

#include "candidates.hpp"
#include "deskew.hpp"
#include "index/index_bytes.hpp"
#include "index/index_window.hpp"
#include "index/own_error.hpp"
#include "index/place_rows.hpp"
#include "input_checks.hpp"
#include "judge.hpp"
#include "near_rivals.hpp"
#include "place_search.hpp"
#include "pose_search.hpp"
#include "query.hpp"
#include "refine.hpp"
#include "shared_errors.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace stillmap::localization {
namespace {

/// A prior farther than this outside the map's bounds is no place that the map knows [m].
constexpr double kMarginM = 100.0;
/// Fewer points, in the scan or on the surfaces of the map, are no match.
constexpr std::size_t kMinQueryPoints = 50;
/// A scan is found this far from where the map was seen [m].
constexpr double kMaxFromPlaceM = 6.0;
constexpr double kSearchCellM = 1.0;
/// Cosine of the vehicle's tilt in a prior, up to which it may stand elsewhere in the map.
constexpr double kLeastUpright = 0.7;
/// Share of the disagreement around a place by which an answer may be off, and how far away the
/// surfaces are that such a shift turns it by.
constexpr double kOwnErrorShare = 0.25;
constexpr double kOwnErrorArmM = 20.0;

const MapIndex::Level& level_near(const IndexWindow& window, double edge_m) {
  return *std::min_element(window.levels().begin(), window.levels().end(),
                           [&](const auto& a, const auto& b) {
                             return std::abs(std::log(static_cast<double>(a.edge_m) / edge_m)) <
                                    std::abs(std::log(static_cast<double>(b.edge_m) / edge_m));
                           });
}

bool is_beside(const Eigen::AlignedBox3d& bounds, const Eigen::Vector3d& at) {
  return ((at - bounds.min()).array() > -kMarginM).all() &&
         ((at - bounds.max()).array() < kMarginM).all();
}

/// Whether the scan may be where the window around the prior does not reach.
bool is_wide(const PriorReach& reach, const AlignerOptions& options) {
  return reach.radius_m > options.search_radius_m || reach.yaw_rad > options.search_yaw_rad;
}

bool has(const AlignmentResult& result, Reason reason) {
  return std::find(result.reasons.begin(), result.reasons.end(), reason) != result.reasons.end();
}

/// Takes `ok` and its protection back.
void add_doubt(AlignmentResult& result, Reason reason) {
  if (result.status == PoseStatus::kLost) return;
  result.status = PoseStatus::kDegraded;
  result.protection = {};
  if (!has(result, reason)) result.reasons.push_back(reason);
}

/// Whether a scan may well have been taken elsewhere, in the attitude of those that made the map.
bool may_be_farther(const AlignmentResult& result, const Prior& prior,
                    const Eigen::Matrix3d& R_level_lidar) {
  const Eigen::Matrix3d R_map_level = prior.T_map_lidar.linear() * R_level_lidar.transpose();
  if (!(R_map_level(2, 2) > kLeastUpright)) return false;
  return result.status == PoseStatus::kLost || has(result, Reason::kLowInlierRatio);
}

PlaceSearch::Region region_of(const Prior& prior, double radius_m, double yaw_rad,
                              const Eigen::Matrix3d& R_level_lidar) {
  const Eigen::Vector3d forward = prior.T_map_lidar.linear() * R_level_lidar.row(0).transpose();
  PlaceSearch::Region region;
  region.centre_m = prior.T_map_lidar.translation().head<2>();
  region.radius_m = radius_m + kMaxFromPlaceM;
  region.yaw_rad = std::atan2(forward.y(), forward.x());
  region.yaw_window_rad = yaw_rad;
  return region;
}

MotionLeft motion_left_in(const Query& query) {
  if (query.time_offsets_s.empty()) return MotionLeft::kPossible;
  return has_times(query) ? MotionLeft::kNone : MotionLeft::kLittle;
}

/// Of a place where the map is bent or torn: near surfaces and far ones are off by parts of that.
Matrix6d covariance_of_own_error(const maps::PoseDisagreement& own) {
  const double off_m = kOwnErrorShare * static_cast<double>(own.m);
  const double turn_rad = kOwnErrorShare * static_cast<double>(own.rad) + off_m / kOwnErrorArmM;
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(off_m * off_m),
      Eigen::Vector3d::Constant(turn_rad * turn_rad);
  return variances.asDiagonal();
}

}  // namespace

VoxelAligner::VoxelAligner(std::shared_ptr<const MapIndex> index,
                           const std::vector<Eigen::Isometry3d>& seen_from,
                           const LocalizationOptions& options)
    : index_(std::move(index)), options_(options) {
  if (!index_) throw std::invalid_argument("aligner: no map index");
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
  for (const Eigen::Isometry3d& T : seen_from) {
    if (!T.matrix().allFinite()) throw std::invalid_argument("seen_from: a pose is not finite");
  }
  if (!seen_from.empty()) {
    places_ = std::make_unique<const PlaceSearch>(
        *index_, places_of(seen_from, index_->origin(), index_->bounds()));
  } else if (!index_->root().places.empty()) {
    places_ = std::make_unique<const PlaceSearch>(*index_);
  }
}

VoxelAligner::~VoxelAligner() = default;

AlignmentResult VoxelAligner::align(const maps::PointCloud& scan_lidar,
                                    const std::optional<Prior>& prior) const {
  require_usable(scan_lidar);
  return align_thin(thin(view_of(scan_lidar)), prior);
}

ThinScan VoxelAligner::thin(const ScanView& scan_lidar) const {
  const double own_vehicle_m = options_.aligner.own_vehicle_m;
  ThinScan thinned = picked(scan_lidar, thin_points(scan_lidar, own_vehicle_m));
  thinned.own_vehicle_m = static_cast<float>(own_vehicle_m);
  return thinned;
}

AlignmentResult VoxelAligner::align_thin(const ThinScan& scan_lidar,
                                         const std::optional<Prior>& prior) const {
  require_usable(scan_lidar, options_.aligner);
  return prior ? align_near(scan_lidar, *prior) : align_anywhere(scan_lidar);
}

AlignmentResult VoxelAligner::align_near(const ThinScan& scan_lidar, const Prior& prior) const {
  require_usable(prior);
  const AlignerOptions& aligner = options_.aligner;
  const Query query = query_of(scan_lidar, prior.T_map_lidar.linear());
  if (query.points.size() < kMinQueryPoints) {
    return lost(Reason::kTooFewPoints, prior.T_map_lidar);
  }
  if (!is_beside(index_->bounds(), prior.T_map_lidar.translation())) {
    return lost(Reason::kOutsideMap, prior.T_map_lidar);
  }
  const auto max_places = static_cast<std::size_t>(aligner.max_places);
  const std::optional<PriorReach> reach = reach_of(prior);
  std::vector<Eigen::Isometry3d> starts;
  if (places_ && reach && is_wide(*reach, aligner)) {
    starts = places_->best_places(
        query, max_places,
        region_of(prior, reach->radius_m, reach->yaw_rad, places_->R_level_lidar()));
  }
  const PriorReach window = window_of(aligner, reach);
  const auto window_around = index_->around(prior.T_map_lidar.translation());
  const std::vector<Eigen::Isometry3d> near = search_poses(
      level_near(*window_around, kSearchCellM), window_around->origin(), query, prior.T_map_lidar,
      {.radius_m = window.radius_m,
       .yaw_rad = window.yaw_rad,
       .height_m = window.height_m,
       .max_candidates = static_cast<std::size_t>(aligner.max_candidates)});
  starts.insert(starts.end(), near.begin(), near.end());
  AlignmentResult result = align_from(starts, query, &prior);

  // A prior that does not say how good it is, and nothing that fits: look farther away.
  if (reach || !places_ || !(aligner.lost_radius_m > 0.0) ||
      !may_be_farther(result, prior, places_->R_level_lidar()))
    return result;
  const std::vector<Eigen::Isometry3d> farther = places_->best_places(
      query, max_places,
      region_of(prior, aligner.lost_radius_m, aligner.lost_yaw_rad, places_->R_level_lidar()));
  if (farther.empty()) return result;
  starts.insert(starts.end(), farther.begin(), farther.end());
  AlignmentResult wider = align_from(starts, query, &prior);
  const double off_m = (wider.T_map_lidar.translation() - prior.T_map_lidar.translation()).norm();
  if (result.status != PoseStatus::kLost && off_m > window.radius_m) {
    // A place that has changed fits half as well, and one that looks like it was before fits best.
    add_doubt(wider, Reason::kAmbiguous);
  }
  return wider;
}

AlignmentResult VoxelAligner::align_anywhere(const ThinScan& scan_lidar) const {
  if (!places_) return lost(Reason::kNeedsPrior);
  const Query query = query_of(scan_lidar, places_->R_level_lidar());
  if (query.points.size() < kMinQueryPoints) return lost(Reason::kTooFewPoints);
  const std::vector<Eigen::Isometry3d> starts =
      places_->best_places(query, static_cast<std::size_t>(options_.aligner.max_places), {});
  if (starts.empty()) return lost(Reason::kTooLittleStructure);
  return align_from(starts, query, nullptr);
}

AlignmentResult VoxelAligner::align_from(const std::vector<Eigen::Isometry3d>& starts,
                                         const Query& thinned, const Prior* prior) const {
  Search search{.index = *index_, .options = options_, .prior = prior, .query = thinned};
  const Query& query = search.query;

  std::vector<Candidate> candidates = rank_candidates(search, starts);

  Evidence evidence;
  evidence.not_deskewed = give_spinning_times(candidates.front().window->levels(), search.query,
                                              candidates.front().T_index_lidar);
  rank_deskewed(search, candidates);
  put_admitted_first(search, candidates);
  const std::span<const MapIndex::Level> levels = candidates.front().window->levels();
  const MapIndex::Level& finest = levels.back();
  Eigen::Isometry3d& T_index_lidar = candidates.front().T_index_lidar;
  const SweepMotion motion = deskew(levels, search.query, T_index_lidar);

  const Vector6d bend = refine_final(finest, query, T_index_lidar, search.steps);
  const FinalRows final(finest, query, T_index_lidar);
  if (final.rows.count < kMinQueryPoints) {
    return lost(Reason::kLittleOverlap,
                prior != nullptr ? prior->T_map_lidar : Eigen::Isometry3d::Identity());
  }

  evidence.support = support_of(levels, query, T_index_lidar);
  evidence.observability = observability_of(finest, query, T_index_lidar, final.sums.H);
  const std::vector<Vector6d>& degenerate = evidence.observability.degenerate;
  evidence.ambiguous = is_ambiguous(search, candidates, final, degenerate);

  AlignmentResult result;
  result.T_map_lidar = candidates.front().T_map_lidar();
  result.iterations = search.steps;
  const ResidualRows& rows = final.rows;
  result.covariance =
      covariance_of(rows, T_index_lidar, final.kernel_m, bend, degenerate) + motion.pose_covariance;
  result.covariance +=
      covariance_of_shared_errors(rows, T_index_lidar, final.kernel_m, motion_left_in(query));
  result.covariance += covariance_of_own_error(own_error_near(
      index_->root().own_errors, result.T_map_lidar.translation() - index_->origin()));
  result.covariance +=
      covariance_of_near_rivals(finest, query, T_index_lidar, final.sums.H, final.kernel_m);
  evidence.contradicts_prior = prior != nullptr && contradicts(*prior, result);
  judge(evidence, result.covariance, options_.verdict, result);
  return result;
}

}  // namespace stillmap::localization
