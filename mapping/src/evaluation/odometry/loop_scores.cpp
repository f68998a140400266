#include "evaluation/odometry/loop_scores.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr double kRevisitDistanceM = 5.0;
constexpr double kRevisitPathM = 50.0;
constexpr double kFoundWithinPathM = 5.0;
constexpr double kRightM = 0.5;
constexpr double kRightDeg = 2.0;

double share_or_nan(std::size_t count, std::size_t of) {
  return of == 0 ? std::numeric_limits<double>::quiet_NaN()
                 : static_cast<double>(count) / static_cast<double>(of);
}

void judge(EvaluatedLoop& loop, std::span<const Eigen::Isometry3d> path) {
  const Eigen::Isometry3d error =
      loop.T_from_to.inverse() * (path[loop.from].inverse() * path[loop.to]);
  loop.translation_error_m = error.translation().norm();
  loop.rotation_error_deg = Eigen::AngleAxisd(error.linear()).angle() * 180.0 / std::numbers::pi;
  loop.right = loop.translation_error_m <= kRightM && loop.rotation_error_deg <= kRightDeg;
}

bool is_revisit(std::span<const Eigen::Isometry3d> path, std::span<const double> way_m,
                std::size_t keyframe) {
  for (std::size_t i = 0; i < keyframe && way_m[keyframe] - way_m[i] >= kRevisitPathM; ++i) {
    const Eigen::Vector3d between = path[keyframe].translation() - path[i].translation();
    if (between.squaredNorm() <= kRevisitDistanceM * kRevisitDistanceM) return true;
  }
  return false;
}

}  // namespace

LoopScores score_loops(std::span<const Eigen::Isometry3d> path, std::span<const double> way_m,
                       std::span<const EvaluatedLoop> loops) {
  if (path.size() != way_m.size())
    throw std::invalid_argument(fmt::format("way: found {} entries, expected one for each of {}",
                                            way_m.size(), path.size()));
  LoopScores scores;
  std::vector<double> right_at_m;
  for (const EvaluatedLoop& loop : loops) {
    if (std::max(loop.from, loop.to) >= path.size())
      throw std::invalid_argument(fmt::format("loop: found keyframes {} and {}, expected below {}",
                                              loop.from, loop.to, path.size()));
    judge(scores.loops.emplace_back(loop), path);
    if (scores.loops.back().right) right_at_m.push_back(way_m[loop.to]);
  }
  std::sort(right_at_m.begin(), right_at_m.end());
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (!is_revisit(path, way_m, i)) continue;
    ++scores.revisits;
    const auto next =
        std::lower_bound(right_at_m.begin(), right_at_m.end(), way_m[i] - kFoundWithinPathM);
    if (next != right_at_m.end() && *next <= way_m[i] + kFoundWithinPathM) ++scores.revisits_found;
  }
  scores.found = loops.size();
  scores.right = right_at_m.size();
  scores.precision = share_or_nan(scores.right, scores.found);
  scores.recall = share_or_nan(scores.revisits_found, scores.revisits);
  return scores;
}

}  // namespace stillmap::mapping
