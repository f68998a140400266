#include "voxel_aligner.hpp"

#include "index/own_error.hpp"
#include "input_checks.hpp"
#include "near_rivals.hpp"
#include "place_search.hpp"
#include "pose_search.hpp"
#include "query.hpp"
#include "registration.hpp"
#include "settle.hpp"
#include "shared_errors.hpp"
#include "sweep_motion.hpp"
#include "verdict.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

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
constexpr std::size_t kMaxCandidates = 3;
/// Of the whole map more places are looked at closely.
constexpr std::size_t kMaxPlaces = 5;
/// A scan is found this far from where the map was seen [m].
constexpr double kMaxFromPlaceM = 6.0;
constexpr double kSearchCellM = 1.0;
/// Storeys up and down to which the vehicle may belong, unless its prior knows better [m].
constexpr double kStoreysM = 6.0;
/// Share of the best place's support from which a second place is told apart from it on the finest
/// level.
constexpr double kRivalShare = 0.7;
/// Share of the best place's support from which a second place makes the answer ambiguous.
constexpr double kAmbiguousShare = 0.9;
/// Poses along the weakest direction that are compared with the best, by so many points, and the
/// share of its support from which they are looked at closely.
constexpr double kRepeatStepM = 0.25;
constexpr std::size_t kRepeatPoints = 150;
constexpr double kRepeatShare = 0.75;
constexpr double kDistinctM = 0.5;
constexpr double kDistinctRad = 0.035;
/// Last width of the robust kernel as a share of the finest voxel.
constexpr float kFinalKernelShare = 0.15F;
/// Near points decide when the pose by them is farther than this from the one by all alike [m] ...
constexpr double kLeastBendM = 0.02;
/// ... and by more deviations of the first than this ...
constexpr double kLeastBendDeviations = 2.5;
/// ... and leaves all points at least this share of their weights: parked cars that moved by 0.1 m
/// draw near points as well, but leave 0.74 to 0.93 of them, bent maps 0.95 and more.
constexpr double kLeastWeightShare = 0.94;

/// Share of the disagreement around a place by which an answer may be off, and how far away the
/// surfaces are that such a shift turns it by.
constexpr double kOwnErrorShare = 0.25;
constexpr double kOwnErrorArmM = 20.0;

/// Of a pose that was sharpened [m^2, rad^2].
const Vector6d kSharpenedVariance =
    (Vector6d() << Eigen::Vector3d::Constant(1e-3), Eigen::Vector3d::Constant(1e-5)).finished();

const MapIndex::Level& level_near(const MapIndex& index, double edge_m) {
  return *std::min_element(index.levels().begin(), index.levels().end(),
                           [&](const auto& a, const auto& b) {
                             return std::abs(std::log(static_cast<double>(a.edge_m) / edge_m)) <
                                    std::abs(std::log(static_cast<double>(b.edge_m) / edge_m));
                           });
}

/// How far from the prior the scan may be, as its covariance says (three deviations).
struct PriorReach {
  double radius_m = 0.0;
  double height_m = 0.0;
  double yaw_rad = 0.0;
};
/// Cosine of the vehicle's tilt in a prior, up to which it may stand elsewhere in the map.
constexpr double kLeastUpright = 0.7;
/// Where nothing that fits well is found around a prior that does not say how good it is: two
/// seconds of driving late, or half a crossing.
constexpr PriorReach kReachWhenLost{.radius_m = 30.0, .yaw_rad = 1.0};

std::optional<PriorReach> reach_of(const Prior& prior) {
  if (!prior.covariance) return std::nullopt;
  const Matrix6d& covariance = *prior.covariance;
  const Eigen::Matrix3d& R = prior.T_map_lidar.linear();
  const double up_m2 = R.row(2) * covariance.topLeftCorner<3, 3>() * R.row(2).transpose();
  return PriorReach{3.0 * std::sqrt(covariance.diagonal().head<3>().maxCoeff()),
                    3.0 * std::sqrt(up_m2),
                    3.0 * std::sqrt(covariance.diagonal().tail<3>().maxCoeff())};
}

SearchWindow window_of(const std::optional<PriorReach>& reach) {
  SearchWindow window{.height_m = kStoreysM};
  if (!reach) return window;
  // A caller who knows where the vehicle is does not want its neighbour street.
  window.radius_m = std::min(window.radius_m, reach->radius_m);
  window.yaw_rad = std::min(window.yaw_rad, reach->yaw_rad);
  window.height_m = std::min(window.height_m, reach->height_m);
  return window;
}

/// Whether the scan may be where the window around the prior does not reach.
bool is_wide(const PriorReach& reach) {
  const SearchWindow window;
  return reach.radius_m > window.radius_m || reach.yaw_rad > window.yaw_rad;
}

/// Takes `ok` and its protection back.
void add_doubt(AlignmentResult& result, const char* reason) {
  if (result.status == PoseStatus::kLost) return;
  result.status = PoseStatus::kDegraded;
  result.protection = {};
  if (std::find(result.reasons.begin(), result.reasons.end(), reason) == result.reasons.end())
    result.reasons.emplace_back(reason);
}

/// Whether a scan may well have been taken elsewhere, in the attitude of those that made the map.
bool may_be_farther(const AlignmentResult& result, const Prior& prior,
                    const Eigen::Matrix3d& R_level_lidar) {
  const Eigen::Matrix3d R_map_level = prior.T_map_lidar.linear() * R_level_lidar.transpose();
  if (!(R_map_level(2, 2) > kLeastUpright)) return false;
  return result.status == PoseStatus::kLost ||
         std::find(result.reasons.begin(), result.reasons.end(), "low_inlier_ratio") !=
             result.reasons.end();
}

PlaceSearch::Region region_of(const Prior& prior, const PriorReach& reach,
                              const Eigen::Matrix3d& R_level_lidar) {
  const Eigen::Vector3d forward = prior.T_map_lidar.linear() * R_level_lidar.row(0).transpose();
  PlaceSearch::Region region;
  region.centre_m = prior.T_map_lidar.translation().head<2>();
  region.radius_m = reach.radius_m + kMaxFromPlaceM;
  region.yaw_rad = std::atan2(forward.y(), forward.x());
  region.yaw_window_rad = reach.yaw_rad;
  return region;
}

/// Rows of all points at a pose, and their sums.
struct FinalRows {
  FinalRows(const MapIndex::Level& level, const Query& query,
            const Eigen::Isometry3d& T_index_lidar, float bend_share = 0.0F)
      : kernel_m(kFinalKernelShare * level.edge_m),
        matches(level, query.points),
        rows(matches.at(T_index_lidar, kernel_m, bend_share)),
        sums(linearize(rows, T_index_lidar, kernel_m)) {}
  /// Sum of the shares of the kernel that the rows keep.
  [[nodiscard]] double weight() const {
    return static_cast<double>(rows.count) - sums.cost / static_cast<double>(kernel_m * kernel_m);
  }

  float kernel_m;
  Matches matches;
  const ResidualRows& rows;
  NormalEquations sums;
};

/// Share of the way back to the pose by near points that the map's bend asks for.
double share_of_bend(const MapIndex::Level& level, const Query& query, const Place& place,
                     const Vector6d& bend) {
  const double size_m = bend.head<3>().norm();
  if (!(size_m > kLeastBendM)) return 0.0;
  const Eigen::Isometry3d T_by_near = place.T_index_lidar * maps::exp_se3(bend);
  const Matrix6d H = FinalRows(level, query, T_by_near, kBendShare).sums.H;
  if (!(bend.dot(H * bend) > kLeastBendDeviations * kLeastBendDeviations)) return 0.0;
  const double kept = FinalRows(level, query, T_by_near).weight();
  const double all = FinalRows(level, query, place.T_index_lidar).weight();
  return kept > kLeastWeightShare * all ? std::min(1.0, size_m / kLeastBendM - 1.0) : 0.0;
}

/// On the finest level, by what is near and by all alike. @return from the pose by all points to
/// the one by near points.
Vector6d finish(const MapIndex& index, const Query& query, Place& place) {
  const MapIndex::Level& level = index.levels().back();
  Schedule schedule{.first_kernel_m = 0.6F * level.edge_m,
                    .last_kernel_m = kFinalKernelShare * level.edge_m,
                    .max_rounds = 12,
                    .bend_share = kBendShare};
  place.iterations += refine(level, query.points, schedule, place.T_index_lidar);
  const Eigen::Isometry3d T_by_near = place.T_index_lidar;
  schedule.first_kernel_m = 0.3F * level.edge_m;
  schedule.bend_share = 0.0F;
  place.iterations += refine(level, query.points, schedule, place.T_index_lidar);
  Vector6d bend = maps::log_se3(place.T_index_lidar.inverse() * T_by_near);
  const double share = share_of_bend(level, query, place, bend);
  place.T_index_lidar = maps::renormalized(place.T_index_lidar * maps::exp_se3(share * bend));
  return bend;
}

bool distinct(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  const Eigen::Isometry3d difference = a.inverse() * b;
  return difference.translation().norm() > kDistinctM ||
         maps::rotation_angle_rad(difference.linear()) > kDistinctRad;
}

/// Whether one pose is distinct from another by more than a motion along directions that are free
/// anyway.
bool is_elsewhere(const Eigen::Isometry3d& T, const Eigen::Isometry3d& T_from,
                  const std::vector<Vector6d>& free_directions) {
  Vector6d way = maps::log_se3(T_from.inverse() * T);
  way.tail<3>() *= kLeverM;
  for (const Vector6d& free : free_directions) way -= free.dot(way) * free;
  return way.head<3>().norm() > kDistinctM || way.tail<3>().norm() > kLeverM * kDistinctRad;
}

void sort_by_support(std::vector<Place>& places) {
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.support > b.support; });
}

/// Settles each start and tells those apart that look much alike: the best first, each place once,
/// and all Gauss-Newton steps counted with the first.
/// @param starts  `T_map_lidar`, at least one.
std::vector<Place> places_among(const MapIndex& index, const Query& query,
                                const std::vector<Eigen::Isometry3d>& starts) {
  std::vector<Place> settled;
  for (const Eigen::Isometry3d& T_map_lidar : starts) {
    // A prior is a rotation but for its last digits, a place found with floats but for a few more;
    // where nothing moves the pose it would be answered as it came.
    Eigen::Isometry3d T_index_lidar = maps::renormalized(T_map_lidar);
    T_index_lidar.translation() -= index.origin();
    settled.push_back(settle(index.levels(), query, T_index_lidar, kBendShare));
  }
  sort_by_support(settled);
  std::vector<Place> apart;
  int steps = 0;
  for (Place& place : settled) {
    steps += std::exchange(place.iterations, 0);
    const bool rivals = place.support >= kRivalShare * settled.front().support;
    const bool known = std::any_of(apart.begin(), apart.end(), [&](const Place& other) {
      return !distinct(place.T_index_lidar, other.T_index_lidar);
    });
    if (rivals && !known) apart.push_back(place);
  }
  if (apart.size() > 1) {
    for (Place& place : apart) {
      sharpen(index.levels(), query, kBendShare, place);
      steps += std::exchange(place.iterations, 0);
    }
    sort_by_support(apart);
  }
  apart.front().iterations = steps;
  return apart;
}

/// Whether a prior's covariance admits a place, give or take what sharpening leaves.
bool admits(const Prior* prior, const MapIndex& index, const Eigen::Isometry3d& T_index_lidar) {
  if (prior == nullptr || !prior->covariance) return true;
  AlignmentResult there;
  there.T_map_lidar = T_index_lidar;
  there.T_map_lidar.translation() += index.origin();
  there.covariance = kSharpenedVariance.asDiagonal();
  return !contradicts(*prior, there);
}

/// Whether the scan fits as well a little farther along the direction that holds it least: what
/// repeats itself every metre or two leads the coarser levels between two repeats.
/// @param H  at the pose.
/// @param prior  may be null; repeats that it does not admit do not count.
bool repeats_itself(const MapIndex& index, const Query& query, const Prior* prior,
                    const Eigen::Isometry3d& T_index_lidar, const Matrix6d& H, double reach_m) {
  const maps::SymmetricEigen<3> eigen = maps::eigen_of(Eigen::Matrix3d(H.topLeftCorner<3, 3>()));
  const Eigen::Vector3d along = eigen.vectors.col(0);
  const std::size_t stride = std::max<std::size_t>(1, query.points.size() / kRepeatPoints);
  const auto support = [&](const Eigen::Isometry3d& T) {
    return support_at(index.levels(), query, T, stride);
  };
  const double least = kRepeatShare * support(T_index_lidar);
  std::vector<Place> alike;
  for (const double way : {-1.0, 1.0}) {
    Place best{T_index_lidar, least};
    for (double off_m = kDistinctM; off_m <= reach_m; off_m += kRepeatStepM) {
      const Eigen::Isometry3d T = T_index_lidar * Eigen::Translation3d(way * off_m * along);
      if (const double here = support(T); here > best.support) best = {T, here};
    }
    if (best.support > least) alike.push_back(best);
  }
  if (alike.empty()) return false;
  Place own{T_index_lidar};
  sharpen(index.levels(), query, kBendShare, own);
  return std::any_of(alike.begin(), alike.end(), [&](Place& other) {
    sharpen(index.levels(), query, kBendShare, other);
    return other.support > kAmbiguousShare * own.support &&
           admits(prior, index, other.T_index_lidar) &&
           distinct(other.T_index_lidar, T_index_lidar);
  });
}

/// Of places that fit about as well, takes those first that the prior admits.
void put_admitted_first(const MapIndex& index, const Prior* prior, std::vector<Place>& places) {
  const double least = kAmbiguousShare * places.front().support;
  const int steps = std::exchange(places.front().iterations, 0);
  std::stable_partition(places.begin(), places.end(), [&](const Place& place) {
    return place.support > least && admits(prior, index, place.T_index_lidar);
  });
  places.front().iterations = steps;
}

/// Measures the support of places that look alike anew, with the motion that each of them tells
/// taken out of the scan: one that was taken on the move fits no place well as it came.
void straighten_rivals(const MapIndex& index, const Query& query, std::vector<Place>& places) {
  if (places.size() < 2 || !is_of_a_while(query)) return;
  int steps = 0;
  for (Place& place : places) {
    Query straight = query;
    (void)straighten(index.levels(), straight, place.T_index_lidar);
    sharpen(index.levels(), straight, kBendShare, place);
    steps += std::exchange(place.iterations, 0);
  }
  sort_by_support(places);
  places.front().iterations = steps;
}

MotionLeft motion_left_in(const Query& query) {
  if (query.time_offsets_s.empty()) return MotionLeft::kPossible;
  return is_of_a_while(query) ? MotionLeft::kNone : MotionLeft::kLittle;
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

/// Refines each start coarse to fine, finishes the best of them and judges it.
/// @param starts  `T_map_lidar`, at least one. @param prior  may be null.
AlignmentResult align_among(const MapIndex& index, Query query,
                            const std::vector<Eigen::Isometry3d>& starts, const Prior* prior) {
  const std::optional<PriorReach> reach = prior != nullptr ? reach_of(*prior) : std::nullopt;
  std::vector<Place> places = places_among(index, query, starts);
  Evidence evidence;
  evidence.not_deskewed = take_times_of_a_turn(index.levels(), query, places.front().T_index_lidar);
  straighten_rivals(index, query, places);
  put_admitted_first(index, prior, places);
  Place& best = places.front();
  const SweepMotion motion = straighten(index.levels(), query, best.T_index_lidar);
  const Vector6d bend = finish(index, query, best);

  const MapIndex::Level& level = index.levels().back();
  const FinalRows final(level, query, best.T_index_lidar);
  evidence.support = support_of(index.levels(), query, best.T_index_lidar);
  if (final.rows.count < kMinQueryPoints) {
    return lost("little_overlap",
                prior != nullptr ? prior->T_map_lidar : Eigen::Isometry3d::Identity());
  }
  evidence.observability = observability_of(level, query, best.T_index_lidar, final.sums.H);
  evidence.ambiguous = std::any_of(places.begin() + 1, places.end(), [&](const Place& other) {
    return other.support > kAmbiguousShare * best.support &&
           admits(prior, index, other.T_index_lidar) &&
           is_elsewhere(other.T_index_lidar, best.T_index_lidar, evidence.observability.degenerate);
  });
  if (!evidence.ambiguous && evidence.observability.degenerate.empty()) {
    evidence.ambiguous = repeats_itself(index, query, prior, best.T_index_lidar, final.sums.H,
                                        window_of(reach).radius_m);
  }
  AlignmentResult result;
  result.T_map_lidar = best.T_index_lidar;
  result.T_map_lidar.translation() += index.origin();
  result.iterations = best.iterations;
  result.covariance = covariance_of(final.rows, best.T_index_lidar, final.kernel_m, bend,
                                    evidence.observability.degenerate) +
                      motion.pose_covariance;
  result.covariance += covariance_of_shared_errors(final.rows, best.T_index_lidar, final.kernel_m,
                                                   motion_left_in(query));
  result.covariance +=
      covariance_of_own_error(index.own_error().near(result.T_map_lidar.translation()));
  result.covariance +=
      covariance_of_near_rivals(level, query, best.T_index_lidar, final.sums.H, final.kernel_m);
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
  require_usable(scan_lidar);
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
  const std::optional<PriorReach> reach = reach_of(prior);
  std::vector<Eigen::Isometry3d> starts;
  if (places_ && reach && is_wide(*reach))
    starts =
        places_->best_places(query, kMaxPlaces, region_of(prior, *reach, places_->R_level_lidar()));
  for (const Eigen::Isometry3d& T_map_lidar :
       search_poses(level_near(*index_, kSearchCellM), index_->origin(), query, prior.T_map_lidar,
                    window_of(reach), kMaxCandidates)) {
    starts.push_back(T_map_lidar);
  }
  AlignmentResult result = align_among(*index_, query, starts, &prior);
  if (reach || !places_ || !may_be_farther(result, prior, places_->R_level_lidar())) return result;
  const std::vector<Eigen::Isometry3d> farther = places_->best_places(
      query, kMaxPlaces, region_of(prior, kReachWhenLost, places_->R_level_lidar()));
  if (farther.empty()) return result;
  starts.insert(starts.end(), farther.begin(), farther.end());
  AlignmentResult wider = align_among(*index_, query, starts, &prior);
  const double off_m = (wider.T_map_lidar.translation() - prior.T_map_lidar.translation()).norm();
  if (result.status != PoseStatus::kLost && off_m > window_of(reach).radius_m) {
    // A place that has changed fits half as well, and one that looks like it was before fits best.
    add_doubt(wider, "ambiguous");
  }
  return wider;
}

AlignmentResult VoxelAligner::align_anywhere(const maps::PointCloud& scan_lidar) const {
  if (!places_) return lost("needs_prior");
  const Query query = thin(scan_lidar, places_->R_level_lidar());
  if (query.points.size() < kMinQueryPoints) return lost("too_few_points");
  const std::vector<Eigen::Isometry3d> starts = places_->best_places(query, kMaxPlaces, {});
  if (starts.empty()) return lost("too_little_structure");
  return align_among(*index_, query, starts, nullptr);
}

}  // namespace stillmap::localization
