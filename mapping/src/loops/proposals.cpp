#include "loops/proposals.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Looked up by ring key, compared by columns, and kept.
constexpr std::size_t kByRingKey = 40;
constexpr double kMostContextDistance = 0.4;
constexpr std::size_t kByContext = 3;
/// Along the path, places closer than this are one [m].
constexpr double kOnePlaceM = 10.0;

/// A loop tells where the path is this far from its ends [m].
constexpr double kLoopReachM = 60.0;
/// A revisit is that near [m]: another lane.
constexpr double kRevisitM = 8.0;
/// Looking alike reaches that far [m].
constexpr double kAlikeM = 15.0;
/// Deviations.
constexpr double kProposed = 2.0;
constexpr double kPlausible = 4.0;
/// Given places are looked for this far around at least, as deviations [m, rad].
constexpr double kLeastGivenM = 0.3;
constexpr double kLeastGivenRad = 0.02;
/// A drift beyond it tells too little: looks must [m].
constexpr double kMostDriftM = 8.0;

bool may_loop(const OdometryPath& path, std::size_t place, std::size_t query) {
  return place < query && path.way_m(place, query) >= kLeastLoopWayM;
}

double deviation_m(const UncertainMotion& motion) {
  return std::sqrt(motion.covariance.diagonal().head<3>().maxCoeff());
}

std::vector<RingKey> keys_of(const std::vector<ScanContext>& contexts) {
  std::vector<RingKey> keys;
  keys.reserve(contexts.size());
  for (const ScanContext& context : contexts) keys.push_back(ring_key(context));
  return keys;
}

}  // namespace

ContextProposals::ContextProposals(const std::vector<ScanContext>& contexts,
                                   const OdometryPath& path)
    : contexts_(contexts), path_(path), keys_(keys_of(contexts)) {}

std::vector<Proposal> ContextProposals::of(std::size_t query) const {
  std::vector<std::pair<ContextDistance, std::size_t>> alike;
  const auto allowed = [&](std::size_t place) { return may_loop(path_, place, query); };
  for (const std::size_t place : keys_.nearest(ring_key(contexts_[query]), kByRingKey, allowed)) {
    const ContextDistance found = distance_between(contexts_[query], contexts_[place]);
    if (found.distance < kMostContextDistance) alike.emplace_back(found, place);
  }
  std::stable_sort(alike.begin(), alike.end(), [](const auto& a, const auto& b) {
    return a.first.distance < b.first.distance;
  });
  std::vector<Proposal> out;
  for (const auto& [found, place] : alike) {
    if (out.size() == kByContext) break;
    const bool known = std::any_of(out.begin(), out.end(), [&, at = place](const Proposal& other) {
      return path_.way_m(other.place, at) < kOnePlaceM;
    });
    if (known) continue;
    const double turn_rad = 2.0 * std::numbers::pi * found.shift / kContextSectors;
    const Eigen::Matrix3d R_level_place = R_level_lidar(path_.T_odom_lidar(place));
    const Eigen::Matrix3d R_level_query = R_level_lidar(path_.T_odom_lidar(query));
    Proposal proposal;
    proposal.query = query;
    proposal.place = place;
    proposal.T_place_query.linear() =
        R_level_place.transpose() *
        Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix() * R_level_query;
    out.push_back(proposal);
  }
  return out;
}

PathProposals::PathProposals(const OdometryPath& path, const Submaps& submaps,
                             const std::vector<Loop>& loops,
                             const std::optional<GivenPlaces>& given)
    : path_(path), submaps_(submaps), loops_(loops), given_(given) {
  std::stable_sort(loops_.begin(), loops_.end(),
                   [](const Loop& a, const Loop& b) { return a.to < b.to; });
}

std::vector<const Loop*> PathProposals::loops_near(std::size_t query) const {
  const auto after = std::lower_bound(loops_.begin(), loops_.end(), query,
                                      [](const Loop& loop, std::size_t i) { return loop.to < i; });
  std::vector<const Loop*> out;
  if (after != loops_.end()) out.push_back(&*after);
  if (after != loops_.begin()) out.push_back(&*std::prev(after));
  std::erase_if(out, [&](const Loop* loop) { return path_.way_m(loop->to, query) > kLoopReachM; });
  std::stable_sort(out.begin(), out.end(), [&](const Loop* a, const Loop* b) {
    return path_.way_m(a->to, query) < path_.way_m(b->to, query);
  });
  return out;
}

std::optional<Proposal> PathProposals::through(const Loop& loop, std::size_t query) const {
  const UncertainMotion from_query =
      composed({loop.T_from_to, loop.covariance}, path_.motion(loop.to, query));
  const Eigen::Isometry3d T_odom_query = path_.T_odom_lidar(loop.from) * from_query.T;
  const auto away_m = [&](std::size_t place) {
    return (path_.T_odom_lidar(place).translation() - T_odom_query.translation()).norm();
  };
  std::size_t best = loop.from;
  const auto look = [&](std::size_t place) {
    if (path_.way_m(place, loop.from) > 2.0 * kLoopReachM) return false;
    if (away_m(place) < away_m(best)) best = place;
    return true;
  };
  for (std::size_t place = loop.from; place < path_.size() && look(place); ++place) continue;
  for (std::size_t place = loop.from; place-- > 0 && look(place);) continue;
  if (!may_loop(path_, best, query)) return std::nullopt;
  const UncertainMotion found = composed(path_.motion(best, loop.from), from_query);
  if (found.T.translation().norm() > kRevisitM + kProposed * deviation_m(found))
    return std::nullopt;
  return Proposal{query, best, found.T, found.covariance};
}

std::optional<Proposal> PathProposals::by_odometry(std::size_t query) const {
  std::optional<Proposal> best;
  double best_m = 0.0;
  for (std::size_t submap = 0; submap < submaps_.size(); ++submap) {
    const std::size_t place = submaps_.centre(submap);
    if (!may_loop(path_, place, query) || path_.drive(place) != path_.drive(query)) continue;
    if (OdometryPath::least_drift_m(path_.way_m(place, query)) > kMostDriftM) continue;
    const double away_m =
        (path_.T_odom_lidar(place).translation() - path_.T_odom_lidar(query).translation()).norm();
    if (away_m > kRevisitM + kProposed * kMostDriftM || (best && away_m >= best_m)) continue;
    const UncertainMotion motion = path_.motion(place, query);
    const double deviation = deviation_m(motion);
    if (deviation > kMostDriftM || away_m > kRevisitM + kProposed * deviation) continue;
    best = Proposal{query, place, motion.T, motion.covariance};
    best_m = away_m;
  }
  return best;
}

UncertainMotion PathProposals::given_motion(std::size_t from, std::size_t to) const {
  const Eigen::Isometry3d T = given_->T_map_lidar[from].inverse() * given_->T_map_lidar[to];
  // Of both ends; an error of the turn at the far end moves what is near.
  const double sigma_m = std::max(kLeastGivenM, 2.0 * given_->sigma_m) +
                         2.0 * given_->sigma_rad * T.translation().norm();
  const double sigma_rad = std::max(kLeastGivenRad, 2.0 * given_->sigma_rad);
  Eigen::Matrix<double, 6, 1> variances;
  variances.head<3>().setConstant(sigma_m * sigma_m);
  variances.tail<3>().setConstant(sigma_rad * sigma_rad);
  return {T, variances.asDiagonal()};
}

std::optional<Proposal> PathProposals::by_given(std::size_t query) const {
  std::optional<Proposal> best;
  double best_m = kRevisitM + kProposed * std::min(given_->sigma_m, kMostDriftM);
  for (std::size_t submap = 0; submap < submaps_.size(); ++submap) {
    const std::size_t place = submaps_.centre(submap);
    if (!may_loop(path_, place, query)) continue;
    const double away_m =
        (given_->T_map_lidar[place].translation() - given_->T_map_lidar[query].translation())
            .norm();
    if (!(away_m < best_m)) continue;
    const UncertainMotion motion = given_motion(place, query);
    best = Proposal{query, place, motion.T, motion.covariance};
    best_m = away_m;
  }
  return best;
}

std::optional<Proposal> PathProposals::of(std::size_t query) const {
  const std::vector<const Loop*> near = loops_near(query);
  for (const Loop* loop : near) {
    if (auto found = through(*loop, query)) return found;
  }
  if (given_) return by_given(query);
  return near.empty() ? by_odometry(query) : std::nullopt;
}

bool PathProposals::plausible(std::size_t query, std::size_t place) const {
  const auto agrees = [&](const UncertainMotion& motion) {
    return motion.T.translation().norm() < kAlikeM + kPlausible * deviation_m(motion);
  };
  for (const Loop* loop : loops_near(query)) {
    if (path_.way_m(loop->from, place) > 2.0 * kLoopReachM) continue;
    const UncertainMotion found =
        composed(path_.motion(place, loop->from),
                 composed({loop->T_from_to, loop->covariance}, path_.motion(loop->to, query)));
    if (!agrees(found)) return false;
  }
  if (given_ && !agrees(given_motion(place, query))) return false;
  return path_.drive(place) != path_.drive(query) || agrees(path_.motion(place, query));
}

}  // namespace stillmap::mapping
