#include "trajectory/given_pose_errors.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <ranges>

namespace stillmap::mapping {
namespace {

constexpr std::array kWaysM{0.0, 3.0, 10.0, 30.0, 100.0};
/// What a scan's doubt is taken from.
constexpr double kDoubtWayM = 10.0;
constexpr std::size_t kDoubtScans = 5;
/// Where nothing tells [m, rad]: as of a good GNSS.
constexpr double kUntoldSigmaM = 0.1;
constexpr double kUntoldSigmaRad = 2e-3;
/// Median length of a normal vector of three directions, for a deviation of 1 in each.
constexpr double kMedianLength = 1.538;
/// Matches are not better [m, rad].
constexpr double kLeastSigmaM = 0.005;
constexpr double kLeastSigmaRad = 2e-4;
/// Errors go together up to the way on which so much of the largest difference shows.
constexpr double kShown = 0.7;

double sigma_of(double median_length) { return median_length / (kMedianLength * std::sqrt(2.0)); }

/// Calls with pairs of scans that are so far apart along the way, each scan once as the first of a
/// pair; 0 = neighbours.
/// Scans that were predicted, be it along one direction, do not count: that may be the given
/// motion.
template <typename Visit>
void for_each_pair(const TwicePosed& drive, double way_m, const Visit& visit) {
  const auto& odometry = drive.odometry;
  std::vector<double> ways(odometry.size());
  std::vector<std::size_t> predicted(odometry.size());
  for (std::size_t i = 1; i < odometry.size(); ++i) {
    ways[i] = ways[i - 1] +
              (odometry[i].T_odom_lidar.translation() - odometry[i - 1].T_odom_lidar.translation())
                  .norm();
    predicted[i] = predicted[i - 1] + (odometry[i].status == OdometryStatus::kMatched ? 0U : 1U);
  }
  std::size_t to = 0;
  for (std::size_t from = 0; from < odometry.size(); ++from) {
    to = std::max(to, from + 1);
    while (to < odometry.size() && ways[to] - ways[from] < way_m) ++to;
    if (to == odometry.size()) return;
    if (predicted[to] != predicted[from]) continue;
    visit(from, to, odometry[from].T_odom_lidar.inverse() * odometry[to].T_odom_lidar,
          drive.T_map_given[from].inverse() * drive.T_map_given[to]);
  }
}

/// What odometry is off from true poses on streets (0.5 cm over 10 m on simulated ones, 2 cm on a
/// real one, mapping/given_poses.md), with some room:
/// medians to neighbours, over ways and at loops, and no neighbour that is far off.
constexpr double kAgreeNeighboursM = 0.01;
constexpr double kAgreeWaysM = 0.03;
constexpr double kAgreeWaysUpToM = 10.0;
constexpr double kAgreeLoopsM = 0.03;
constexpr double kAgreeMostM = 0.05;
constexpr double kAgreeNeighboursRad = 1e-3;
constexpr double kAgreeWaysRad = 2e-3;

/// On the first metres of a drive odometry of sparse sensors turns by a degree and more.
constexpr double kStartM = 15.0;

}  // namespace

void DifferenceList::add(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  const Eigen::Isometry3d T = a.inverse() * b;
  lengths_m.push_back(T.translation().norm());
  angles_rad.push_back(maps::rotation_angle_rad(T.linear()));
}

void DifferenceList::append(const DifferenceList& other) {
  lengths_m.insert(lengths_m.end(), other.lengths_m.begin(), other.lengths_m.end());
  angles_rad.insert(angles_rad.end(), other.angles_rad.begin(), other.angles_rad.end());
}

PoseDifferences summary(DifferenceList& list, double way_m) {
  PoseDifferences found;
  found.way_m = way_m;
  found.pairs = list.lengths_m.size();
  if (found.pairs == 0) return found;
  found.median_m = maps::quantile(list.lengths_m, 0.5);
  found.p95_m = maps::quantile(list.lengths_m, 0.95);
  found.max_m = maps::quantile(list.lengths_m, 1.0);
  found.median_rad = maps::quantile(list.angles_rad, 0.5);
  found.p95_rad = maps::quantile(list.angles_rad, 0.95);
  found.max_rad = maps::quantile(list.angles_rad, 1.0);
  return found;
}

bool GivenPoseErrors::agree() const {
  if (neighbours_m.empty()) return false;
  const auto within = [](const PoseDifferences& apart, double most_m, double most_rad) {
    return apart.pairs == 0 || (apart.median_m <= most_m && apart.median_rad <= most_rad);
  };
  if (!within(by_way.front(), kAgreeNeighboursM, kAgreeNeighboursRad) ||
      by_way.front().max_m > kAgreeMostM)
    return false;
  return within(loops, kAgreeLoopsM, kAgreeWaysRad) &&
         std::ranges::all_of(by_way, [&](const PoseDifferences& apart) {
           return apart.way_m > kAgreeWaysUpToM || within(apart, kAgreeWaysM, kAgreeWaysRad);
         });
}

GivenPoseErrors given_pose_errors(std::span<const TwicePosed> drives) {
  GivenPoseErrors errors;
  errors.sigma_m = kLeastSigmaM;
  errors.sigma_rad = kLeastSigmaRad;
  double most_m = 0.0;
  for (const double way_m : kWaysM) {
    DifferenceList found;
    for (const TwicePosed& drive : drives)
      for_each_pair(drive, way_m,
                    [&](std::size_t, std::size_t, const Eigen::Isometry3d& T_odometry,
                        const Eigen::Isometry3d& T_given) { found.add(T_odometry, T_given); });
    if (errors.by_way.empty()) errors.neighbours_m = found.lengths_m;
    const PoseDifferences apart = summary(found, way_m);
    errors.by_way.push_back(apart);
    if (apart.pairs == 0) continue;
    errors.sigma_m = std::max(errors.sigma_m, sigma_of(apart.median_m));
    errors.sigma_rad = std::max(errors.sigma_rad, sigma_of(apart.median_rad));
    most_m = std::max(most_m, apart.median_m);
  }
  // A sensor that looks aside of where its poses say turns all of them alike, which no difference
  // of turns shows: its way leads aside then.
  for (const PoseDifferences& apart : errors.by_way | std::views::reverse) {
    if (apart.pairs == 0 || apart.way_m == 0.0) continue;
    errors.sigma_rad = std::max(errors.sigma_rad, apart.median_m / apart.way_m);
    break;
  }
  if (errors.neighbours_m.empty()) {
    errors.sigma_m = kUntoldSigmaM;
    errors.sigma_rad = kUntoldSigmaRad;
  }
  for (const PoseDifferences& apart : errors.by_way) {
    if (apart.pairs == 0 || apart.median_m < kShown * most_m) continue;
    errors.correlated_m = apart.way_m;
    break;
  }
  return errors;
}

std::vector<maps::PoseDisagreement> doubts_of(const TwicePosed& drive) {
  std::vector<maps::PoseDisagreement> doubts(drive.odometry.size());
  for (const double way_m : {0.0, kDoubtWayM}) {
    std::vector<DifferenceList> of_scan(doubts.size());
    for_each_pair(drive, way_m,
                  [&](std::size_t from, std::size_t to, const Eigen::Isometry3d& T_odometry,
                      const Eigen::Isometry3d& T_given) {
                    of_scan[from].add(T_odometry, T_given);
                    of_scan[to].add(T_odometry, T_given);
                  });
    for (std::size_t scan = 0; scan < doubts.size(); ++scan) {
      DifferenceList around;
      const std::size_t begin = scan > kDoubtScans ? scan - kDoubtScans : 0;
      const std::size_t end = std::min(scan + kDoubtScans + 1, doubts.size());
      for (std::size_t near = begin; near < end; ++near) around.append(of_scan[near]);
      PoseDifferences apart = summary(around, way_m);
      if (apart.pairs == 0 && way_m == 0.0) {
        apart.median_m = kUntoldSigmaM;
        apart.median_rad = kUntoldSigmaRad;
      }
      const double of_each = 1.0 / std::numbers::sqrt2;
      doubts[scan].m = std::max(doubts[scan].m, static_cast<float>(of_each * apart.median_m));
      doubts[scan].rad = std::max(doubts[scan].rad, static_cast<float>(of_each * apart.median_rad));
    }
  }
  return doubts;
}

std::vector<maps::PoseDisagreement> disagreements_of(const TwicePosed& drive) {
  struct Pair {
    std::size_t from, to;
    float m, rad;
  };
  std::vector<Pair> pairs;
  for_each_pair(drive, kDoubtWayM,
                [&](std::size_t from, std::size_t to, const Eigen::Isometry3d& T_odometry,
                    const Eigen::Isometry3d& T_given) {
                  const Eigen::Isometry3d& T_start = drive.odometry.front().T_odom_lidar;
                  const Eigen::Isometry3d& T_from = drive.odometry[from].T_odom_lidar;
                  if ((T_start.inverse() * T_from).translation().norm() < kStartM) return;
                  const Eigen::Isometry3d apart = T_odometry.inverse() * T_given;
                  pairs.push_back({from, to, static_cast<float>(apart.translation().norm()),
                                   static_cast<float>(maps::rotation_angle_rad(apart.linear()))});
                });
  std::vector<maps::PoseDisagreement> found(drive.odometry.size());
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    // The second largest of three in a row: one alone is odometry's.
    const Pair& before = pairs[i > 0 ? i - 1 : i + 1 < pairs.size() ? i + 1 : i];
    const Pair& after = pairs[i + 1 < pairs.size() ? i + 1 : i > 0 ? i - 1 : i];
    const auto confirmed = [&](float Pair::*value) {
      const float most = std::max(before.*value, after.*value);
      return std::max(std::min(pairs[i].*value, most), std::min(before.*value, after.*value));
    };
    for (const std::size_t scan : {pairs[i].from, pairs[i].to})
      found[scan] = {std::max(found[scan].m, confirmed(&Pair::m)),
                     std::max(found[scan].rad, confirmed(&Pair::rad))};
  }
  return found;
}

std::vector<maps::PoseDisagreement> doubts_of(std::span<const OdometryPose> odometry) {
  std::vector<maps::PoseDisagreement> doubts(odometry.size());
  for (std::size_t scan = 1; scan < odometry.size(); ++scan) {
    if (odometry[scan].status != OdometryStatus::kPredicted) continue;
    const auto& variances = odometry[scan].covariance.diagonal();
    doubts[scan] = {static_cast<float>(std::sqrt(variances.head<3>().maxCoeff())),
                    static_cast<float>(std::sqrt(variances.tail<3>().maxCoeff()))};
  }
  return doubts;
}

void widen_by_loops(std::span<const Loop> loops, std::span<const Eigen::Isometry3d> T_map_given,
                    GivenPoseErrors& errors) {
  DifferenceList found;
  for (const Loop& loop : loops)
    found.add(loop.T_from_to, T_map_given[loop.from].inverse() * T_map_given[loop.to]);
  const PoseDifferences apart = summary(found);
  errors.loops = apart;
  if (apart.pairs == 0) return;
  errors.sigma_m = std::max(errors.sigma_m, sigma_of(apart.median_m));
  errors.sigma_rad = std::max(errors.sigma_rad, sigma_of(apart.median_rad));
}

}  // namespace stillmap::mapping
