#include "near_rivals.hpp"

#include "registration.hpp"

#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace stillmap::localization {
namespace {

/// Shifts that are tried [m], 0.1 m apart: the final kernel is 0.075 m wide.
constexpr std::array<double, 4> kShiftsM = {0.2, 0.3, 0.4, 0.5};
/// Standing points that are shifted, and points that a rival is refined by.
constexpr std::size_t kShiftedPoints = 100;
constexpr std::size_t kRefinedPoints = 1000;
/// Share of the information along a shift from which a shifted pose is looked at closely.
constexpr double kLookedAtShare = 0.3;
/// A rival explains at least this share of what the pose explains.
constexpr double kNearRivalShare = 0.9;
constexpr double kNearestRivalM = 0.1;
constexpr double kFarthestRivalM = 0.7;
/// Deviation of a pose with a rival, as a share of the way to it: its levels reach some twice as
/// far.
constexpr double kRivalDeviation = 0.3;

/// The points that stand, some of them.
std::vector<Eigen::Vector3f> some_standing(const Query& query) {
  std::vector<Eigen::Vector3f> points;
  const std::size_t stride = query.standing.size() / kShiftedPoints + 1;
  for (std::size_t i = 0; i < query.standing.size(); i += stride)
    points.push_back(query.points[query.standing[i]]);
  return points;
}

/// What the rows keep of their kernel.
double kept(const ResidualRows& rows, const Eigen::Isometry3d& T_index_lidar, float kernel_m) {
  return static_cast<double>(rows.count) -
         linearize(rows, T_index_lidar, kernel_m).cost / static_cast<double>(kernel_m * kernel_m);
}

}  // namespace

Matrix6d covariance_of_near_rivals(const MapIndex::Level& level, const Query& query,
                                   const Eigen::Isometry3d& T_index_lidar, const Matrix6d& H,
                                   float kernel_m) {
  Matrix6d covariance = Matrix6d::Zero();
  const std::vector<Eigen::Vector3f> standing = some_standing(query);
  Matches shifted(level, standing);
  const auto information = [&](const Eigen::Isometry3d& T, const Eigen::Vector3d& along) {
    const Matrix6d there = linearize(shifted.at(T, kernel_m), T, kernel_m).H;
    return along.dot(there.topLeftCorner<3, 3>() * along);
  };
  const std::size_t stride = query.points.size() / kRefinedPoints + 1;
  const auto kept_at = [&](const Eigen::Isometry3d& T) {
    Matches all(level, query.points, stride);
    return kept(all.at(T, kernel_m), T, kernel_m);
  };
  // Axes of the horizontal part of H.
  const double angle_rad = 0.5 * std::atan2(2.0 * H(0, 1), H(0, 0) - H(1, 1));
  for (const double axis_rad : {angle_rad, angle_rad + 0.5 * std::numbers::pi}) {
    const Eigen::Vector3d along(std::cos(axis_rad), std::sin(axis_rad), 0.0);
    const double own = information(T_index_lidar, along);
    for (const double sign : {-1.0, 1.0}) {
      double best = kLookedAtShare * own;
      Eigen::Isometry3d T_rival = T_index_lidar;
      for (const double shift_m : kShiftsM) {
        const Eigen::Isometry3d T = T_index_lidar * Eigen::Translation3d(sign * shift_m * along);
        if (const double there = information(T, along); there > best) {
          best = there;
          T_rival = T;
        }
      }
      if (!(best > kLookedAtShare * own)) continue;
      refine(level, query.points,
             {.first_kernel_m = 1.5F * kernel_m,
              .last_kernel_m = kernel_m,
              .stride = stride,
              .max_rounds = 4},
             T_rival);
      const Vector6d way = maps::log_se3(T_index_lidar.inverse() * T_rival);
      const double way_m = way.head<3>().norm();
      if (way_m < kNearestRivalM || way_m > kFarthestRivalM) continue;
      if (kept_at(T_rival) < kNearRivalShare * kept_at(T_index_lidar)) continue;
      covariance += kRivalDeviation * kRivalDeviation * way * way.transpose();
    }
  }
  return covariance;
}

}  // namespace stillmap::localization
