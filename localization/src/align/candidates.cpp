#include "candidates.hpp"

#include "deskew.hpp"
#include "input_checks.hpp"
#include "support.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>

namespace stillmap::localization {
namespace {

/// Share of the best candidate's score from which a second one is compared with it on the finest
/// level.
constexpr double kRivalShare = 0.7;
/// Poses along the weakest direction that are compared with the best, by this many points, and the
/// share of its score from which they are looked at closely.
constexpr double kRepeatStepM = 0.25;
constexpr std::size_t kRepeatPoints = 150;
constexpr double kRepeatShare = 0.75;
/// Poses farther apart than this are different places.
constexpr double kDistinctM = 0.5;
constexpr double kDistinctRad = 0.035;

/// Of a candidate that was refined on the finest level [m^2, rad^2].
const Vector6d kRefinedVariance =
    (Vector6d() << Eigen::Vector3d::Constant(1e-3), Eigen::Vector3d::Constant(1e-5)).finished();

bool distinct(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  const Eigen::Isometry3d difference = a.inverse() * b;
  return difference.translation().norm() > kDistinctM ||
         maps::rotation_angle_rad(difference.linear()) > kDistinctRad;
}

/// Whether one pose is distinct from another by more than a motion along free directions.
bool is_elsewhere(const Eigen::Isometry3d& T, const Eigen::Isometry3d& T_from,
                  const std::vector<Vector6d>& free_directions) {
  Vector6d way = maps::log_se3(T_from.inverse() * T);
  way.tail<3>() *= kLeverM;
  for (const Vector6d& free : free_directions) way -= free.dot(way) * free;
  return way.head<3>().norm() > kDistinctM || way.tail<3>().norm() > kLeverM * kDistinctRad;
}

void sort_by_score(std::vector<Candidate>& candidates) {
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
}

/// Whether the prior's covariance admits a place, up to what refining on the finest level leaves.
bool admits(const Search& search, const Candidate& candidate) {
  if (search.prior == nullptr || !search.prior->covariance) return true;
  AlignmentResult there;
  there.T_map_lidar = candidate.T_map_lidar();
  there.covariance = kRefinedVariance.asDiagonal();
  return !contradicts(*search.prior, there);
}

/// Whether the scan fits as well a little farther along the direction that holds it least: what
/// repeats itself every metre or two leads the coarser levels between two repeats.
/// @param H  at the pose.
bool repeats_itself(const Search& search, const Candidate& found, const Matrix6d& H) {
  const std::span<const MapIndex::Level> levels = found.window->levels();
  const Eigen::Isometry3d& T_index_lidar = found.T_index_lidar;
  const maps::SymmetricEigen<3> eigen = maps::eigen_of(Eigen::Matrix3d(H.topLeftCorner<3, 3>()));
  const Eigen::Vector3d along = eigen.vectors.col(0);
  const std::size_t stride = std::max<std::size_t>(1, search.query.points.size() / kRepeatPoints);
  const double reach_m = window_of(search.options.aligner,
                                   search.prior != nullptr ? reach_of(*search.prior) : std::nullopt)
                             .radius_m;
  const double least = kRepeatShare * score_at(levels, search.query, T_index_lidar, stride);
  std::vector<Candidate> alike;
  for (const double way : {-1.0, 1.0}) {
    Candidate best{T_index_lidar, least, found.window};
    for (double off_m = kDistinctM; off_m <= reach_m; off_m += kRepeatStepM) {
      const Eigen::Isometry3d T = T_index_lidar * Eigen::Translation3d(way * off_m * along);
      const double here = score_above(best.score, levels, search.query, T, stride);
      if (here > best.score) best = {T, here, found.window};
    }
    if (best.score > least) alike.push_back(best);
  }
  if (alike.empty()) return false;
  int uncounted = 0;
  Candidate own{T_index_lidar, 0.0, found.window};
  refine_fine(levels, search.query, own, uncounted);
  return std::any_of(alike.begin(), alike.end(), [&](Candidate& other) {
    refine_fine(levels, search.query, other, uncounted);
    return other.score > search.options.verdict.ambiguous_share * own.score &&
           admits(search, other) && distinct(other.T_index_lidar, T_index_lidar);
  });
}

}  // namespace

std::vector<Candidate> rank_candidates(Search& search,
                                       const std::vector<Eigen::Isometry3d>& starts) {
  std::vector<Candidate> refined;
  for (const Eigen::Isometry3d& T_map_lidar : starts) {
    // A prior is a rotation but for its last digits, a place found with floats but for a few more;
    // where nothing moves the pose it would be answered as it came.
    const auto window = search.index.around(T_map_lidar.translation());
    refined.push_back(refine_coarse(window->levels(), search.query,
                                    window->from_map(maps::renormalized(T_map_lidar)),
                                    search.steps));
    refined.back().window = window;
  }
  sort_by_score(refined);
  std::vector<Candidate> apart;
  for (const Candidate& candidate : refined) {
    const bool rivals = candidate.score >= kRivalShare * refined.front().score;
    const bool known = std::any_of(apart.begin(), apart.end(), [&](const Candidate& other) {
      return !distinct(candidate.T_map_lidar(), other.T_map_lidar());
    });
    if (rivals && !known) apart.push_back(candidate);
  }
  if (apart.size() > 1) {
    for (Candidate& candidate : apart)
      refine_fine(candidate.window->levels(), search.query, candidate, search.steps);
    sort_by_score(apart);
  }
  return apart;
}

void rank_deskewed(Search& search, std::vector<Candidate>& candidates) {
  if (candidates.size() < 2 || !has_times(search.query)) return;
  for (Candidate& candidate : candidates) {
    Query deskewed = search.query;
    (void)deskew(candidate.window->levels(), deskewed, candidate.T_index_lidar);
    refine_fine(candidate.window->levels(), deskewed, candidate, search.steps);
  }
  sort_by_score(candidates);
}

void put_admitted_first(const Search& search, std::vector<Candidate>& candidates) {
  const double least = search.options.verdict.ambiguous_share * candidates.front().score;
  std::stable_partition(candidates.begin(), candidates.end(), [&](const Candidate& candidate) {
    return candidate.score > least && admits(search, candidate);
  });
}

bool is_ambiguous(const Search& search, const std::vector<Candidate>& candidates,
                  const FinalRows& rows, const std::vector<Vector6d>& degenerate) {
  const Candidate& best = candidates.front();
  const bool rival =
      std::any_of(candidates.begin() + 1, candidates.end(), [&](const Candidate& other) {
        return other.score > search.options.verdict.ambiguous_share * best.score &&
               admits(search, other) &&
               is_elsewhere(other.T_map_lidar(), best.T_map_lidar(), degenerate);
      });
  if (rival) return true;
  return degenerate.empty() && repeats_itself(search, best, rows.sums.H);
}

std::optional<PriorReach> reach_of(const Prior& prior) {
  if (!prior.covariance) return std::nullopt;
  const Matrix6d& covariance = *prior.covariance;
  const Eigen::Matrix3d& R = prior.T_map_lidar.linear();
  const double up_m2 = R.row(2) * covariance.topLeftCorner<3, 3>() * R.row(2).transpose();
  return PriorReach{3.0 * std::sqrt(covariance.diagonal().head<3>().maxCoeff()),
                    3.0 * std::sqrt(up_m2),
                    3.0 * std::sqrt(covariance.diagonal().tail<3>().maxCoeff())};
}

PriorReach window_of(const AlignerOptions& options, const std::optional<PriorReach>& reach) {
  PriorReach window{options.search_radius_m, options.search_height_m, options.search_yaw_rad};
  if (!reach) return window;
  // A caller who knows where the vehicle is does not want its neighbour street.
  window.radius_m = std::min(window.radius_m, reach->radius_m);
  window.yaw_rad = std::min(window.yaw_rad, reach->yaw_rad);
  window.height_m = std::min(window.height_m, reach->height_m);
  return window;
}

}  // namespace stillmap::localization
