#include "refine.hpp"

#include "support.hpp"

#include <stillmap/maps/frames.hpp>

#include <algorithm>

namespace stillmap::localization {
namespace {

/// Last width of the robust kernel as a share of the finest voxel.
constexpr float kFinalKernelShare = 0.15F;
/// Near points decide when the pose by them is farther than this from the one by all alike [m] ...
constexpr double kLeastBendM = 0.02;
/// ... and by more deviations of the first than this ...
constexpr double kLeastBendDeviations = 2.5;
/// ... and leaves all points at least this share of their weights: parked cars that moved by 0.1 m
/// draw near points as well, but leave 0.74 to 0.93 of them, bent maps 0.95 and more.
constexpr double kLeastWeightShare = 0.94;

std::size_t stride_of(const Query& query) {
  return std::max<std::size_t>(1, query.points.size() / 1000);
}

/// Share of the way back to the pose by near points that the map's bend asks for.
double share_of_bend(const MapIndex::Level& level, const Query& query,
                     const Eigen::Isometry3d& T_index_lidar, const Vector6d& bend) {
  const double size_m = bend.head<3>().norm();
  if (!(size_m > kLeastBendM)) return 0.0;
  const Eigen::Isometry3d T_by_near = T_index_lidar * maps::exp_se3(bend);
  const Matrix6d H = FinalRows(level, query, T_by_near, kBendShare).sums.H;
  if (!(bend.dot(H * bend) > kLeastBendDeviations * kLeastBendDeviations)) return 0.0;
  const double kept = FinalRows(level, query, T_by_near).weight();
  const double all = FinalRows(level, query, T_index_lidar).weight();
  return kept > kLeastWeightShare * all ? std::min(1.0, size_m / kLeastBendM - 1.0) : 0.0;
}

}  // namespace

double score_at(std::span<const MapIndex::Level> levels, const Query& query,
                const Eigen::Isometry3d& T_index_lidar, std::size_t stride) {
  return support_of(levels, query, T_index_lidar, stride).score();
}

Candidate refine_coarse(std::span<const MapIndex::Level> levels, const Query& query,
                        const Eigen::Isometry3d& T_index_lidar, int& steps, float bend_share) {
  Candidate candidate{T_index_lidar};
  for (const MapIndex::Level& level : levels) {
    if (&level == &levels.back() && levels.size() > 1) break;
    steps += refine(level, query.points,
                    {.first_kernel_m = 0.6F * level.edge_m,
                     .last_kernel_m = 0.3F * level.edge_m,
                     .stride = stride_of(query),
                     .max_rounds = 4,
                     .bend_share = bend_share},
                    candidate.T_index_lidar);
  }
  candidate.score = score_at(levels, query, candidate.T_index_lidar, stride_of(query));
  return candidate;
}

void refine_fine(std::span<const MapIndex::Level> levels, const Query& query, Candidate& candidate,
                 int& steps) {
  const MapIndex::Level& level = levels.back();
  steps += refine(level, query.points,
                  {.first_kernel_m = 0.6F * level.edge_m,
                   .last_kernel_m = 0.2F * level.edge_m,
                   .stride = stride_of(query),
                   .max_rounds = 6,
                   .bend_share = kBendShare},
                  candidate.T_index_lidar);
  candidate.score = score_at(levels, query, candidate.T_index_lidar, stride_of(query));
}

Vector6d refine_final(const MapIndex::Level& finest, const Query& query,
                      Eigen::Isometry3d& T_index_lidar, int& steps) {
  Schedule schedule{.first_kernel_m = 0.6F * finest.edge_m,
                    .last_kernel_m = kFinalKernelShare * finest.edge_m,
                    .max_rounds = 12,
                    .bend_share = kBendShare};
  steps += refine(finest, query.points, schedule, T_index_lidar);
  const Eigen::Isometry3d T_by_near = T_index_lidar;
  schedule.first_kernel_m = 0.3F * finest.edge_m;
  schedule.bend_share = 0.0F;
  steps += refine(finest, query.points, schedule, T_index_lidar);
  Vector6d bend = maps::log_se3(T_index_lidar.inverse() * T_by_near);
  const double share = share_of_bend(finest, query, T_index_lidar, bend);
  T_index_lidar = maps::renormalized(T_index_lidar * maps::exp_se3(share * bend));
  return bend;
}

FinalRows::FinalRows(const MapIndex::Level& finest, const Query& query,
                     const Eigen::Isometry3d& T_index_lidar, float bend_share)
    : kernel_m(kFinalKernelShare * finest.edge_m),
      matches(finest, query.points),
      rows(matches.at(T_index_lidar, kernel_m, bend_share)),
      sums(linearize(rows, T_index_lidar, kernel_m)) {}

double FinalRows::weight() const {
  return static_cast<double>(rows.count) - sums.cost / static_cast<double>(kernel_m * kernel_m);
}

}  // namespace stillmap::localization
