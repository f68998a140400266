#include <stillmap/localization/local_map.hpp>

#include "index/local_voxels.hpp"
#include "noise_information.hpp"
#include "pose_search.hpp"
#include "query.hpp"
#include "refine.hpp"
#include "registration.hpp"
#include "support.hpp"
#include "uncertainty.hpp"

#include <stillmap/maps/frames.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace stillmap::localization {
namespace {

/// First kernel of a level as a share of its edge, as in `refine_coarse`, and the last one as in
/// the aligner of whole maps.
constexpr float kFirstLocalKernelShare = 0.6F;
constexpr float kCoarseKernelShare = 0.3F;
constexpr float kFinalLocalKernelShare = 0.15F;
constexpr std::size_t kCoarsePoints = 1000;
/// How far around a guess it is searched.
constexpr SearchWindow kLocalWindow{
    .radius_m = 6.0, .yaw_rad = 0.40, .height_m = 0.0, .max_candidates = 4};

void require_usable(const Eigen::Isometry3d& T, const char* name) {
  if (T.matrix().allFinite()) return;
  throw std::invalid_argument(fmt::format("{}: found numbers that are not finite", name));
}

/// Up is taken from the odom frame, where the first scan was upright or nearly.
Query query_of(std::span<const Eigen::Vector3f> points_lidar, const Eigen::Matrix3d& R) {
  Query query;
  query.points.assign(points_lidar.begin(), points_lidar.end());
  query.stands = standing_flags(query.points, R.cast<float>());
  for (std::size_t i = 0; i < query.points.size(); ++i) {
    if (query.stands[i] != 0) query.standing.push_back(i);
  }
  return query;
}

}  // namespace

struct LocalMap::State {
  LocalVoxels voxels;

  [[nodiscard]] Eigen::Isometry3d to_local(const Eigen::Isometry3d& T_odom_lidar) const {
    Eigen::Isometry3d T = maps::renormalized(T_odom_lidar);
    T.translation() -= voxels.origin();
    return T;
  }
  [[nodiscard]] Eigen::Isometry3d to_odom(Eigen::Isometry3d T_local_lidar) const {
    T_local_lidar.translation() += voxels.origin();
    return T_local_lidar;
  }
};

LocalMap::LocalMap() : state_(std::make_unique<State>()) {}
LocalMap::~LocalMap() = default;
LocalMap::LocalMap(LocalMap&&) noexcept = default;
LocalMap& LocalMap::operator=(LocalMap&&) noexcept = default;

void LocalMap::add(std::span<const Eigen::Vector3f> points_lidar,
                   const Eigen::Isometry3d& T_odom_lidar) {
  require_usable(T_odom_lidar, "T_odom_lidar");
  state_->voxels.add(points_lidar, T_odom_lidar, kReachM);
}

std::size_t LocalMap::voxel_count() const {
  std::size_t count = 0;
  for (const MapIndex::Level& level : state_->voxels.levels()) count += level.cells.voxel_count();
  return count;
}

Eigen::Isometry3d LocalMap::refined(std::span<const Eigen::Vector3f> points_lidar,
                                    const Eigen::Isometry3d& T_odom_lidar_guess,
                                    double off_m) const {
  require_usable(T_odom_lidar_guess, "T_odom_lidar_guess");
  if (!(off_m > 0.0)) {
    throw std::invalid_argument(fmt::format("off_m: found {}, expected above 0", off_m));
  }
  Eigen::Isometry3d T = state_->to_local(T_odom_lidar_guess);
  const auto off = static_cast<float>(std::min(off_m, LocalMap::kReachM));
  const std::size_t stride = std::max<std::size_t>(1, points_lidar.size() / kCoarsePoints);
  for (const MapIndex::Level& level : state_->voxels.levels()) {
    const bool finest = &level == &state_->voxels.levels().back();
    const float widest_m = kFirstLocalKernelShare * level.edge_m;
    Schedule schedule;
    schedule.last_kernel_m = (finest ? kFinalLocalKernelShare : kCoarseKernelShare) * level.edge_m;
    // What the next finer level reaches needs no coarser one.
    if (!finest && off <= 0.5F * widest_m) continue;
    schedule.first_kernel_m = std::clamp(off, schedule.last_kernel_m, widest_m);
    schedule.stride = finest ? 1 : stride;
    schedule.max_rounds = finest ? 12 : 4;
    refine(level, points_lidar, schedule, T);
  }
  return state_->to_odom(T);
}

Eigen::Isometry3d LocalMap::searched(std::span<const Eigen::Vector3f> points_lidar,
                                     const Eigen::Isometry3d& T_odom_lidar_guess) const {
  require_usable(T_odom_lidar_guess, "T_odom_lidar_guess");
  const std::span<const MapIndex::Level> levels = state_->voxels.levels();
  if (levels.empty()) return T_odom_lidar_guess;
  const Query query = query_of(points_lidar, T_odom_lidar_guess.linear());
  const Eigen::Isometry3d T_guess = maps::renormalized(T_odom_lidar_guess);
  const MapIndex::Level& searched_level = levels[levels.size() - 2];
  std::vector<Eigen::Isometry3d> starts =
      search_poses(searched_level, state_->voxels.origin(), query, T_guess, kLocalWindow);
  starts.push_back(T_guess);
  Candidate best;
  best.score = -1.0;
  int uncounted = 0;
  for (const Eigen::Isometry3d& T_map_lidar : starts) {
    const Candidate candidate =
        refine_coarse(levels, query, state_->to_local(T_map_lidar), uncounted, 0.0F);
    if (candidate.score > best.score) best = candidate;
  }
  return state_->to_odom(best.T_index_lidar);
}

LocalAlignment LocalMap::judged(std::span<const Eigen::Vector3f> points_lidar,
                                const Eigen::Isometry3d& T_odom_lidar) const {
  require_usable(T_odom_lidar, "T_odom_lidar");
  LocalAlignment result;
  result.T_odom_lidar = T_odom_lidar;
  const std::span<const MapIndex::Level> levels = state_->voxels.levels();
  if (levels.empty()) return result;
  const Eigen::Isometry3d T = state_->to_local(T_odom_lidar);
  const MapIndex::Level& level = levels.back();
  const float kernel_m = kFinalLocalKernelShare * level.edge_m;
  const Query query = query_of(points_lidar, T.linear());
  Matches matches(level, query.points);
  const ResidualRows& rows = matches.at(T, kernel_m);
  result.matched = rows.count;
  if (rows.count < LocalAlignment::kMinMatched) return result;
  const Support support = support_of(levels, query, T);
  result.inlier_ratio = support.inlier_ratio;
  result.known_inlier_ratio = support.known_inlier_ratio;
  result.standing_ratio = support.standing_ratio;
  result.rmse_m = support.rmse_m;
  const double kernel2_m2 = static_cast<double>(kernel_m) * static_cast<double>(kernel_m);
  result.fit = (static_cast<double>(rows.count) - linearize(rows, T, kernel_m).cost / kernel2_m2) /
               static_cast<double>(points_lidar.size());
  result.degenerate_directions = untold_directions(noise_information_of(level, query, T, kernel_m));
  result.covariance =
      covariance_of(rows, T, kernel_m, Vector6d::Zero(), result.degenerate_directions);
  return result;
}

}  // namespace stillmap::localization
