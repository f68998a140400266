#include "deskew.hpp"

#include "clustered_sums.hpp"

#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

namespace stillmap::localization {
namespace {

using Vector12d = Eigen::Matrix<double, 12, 1>;
using Matrix12d = Eigen::Matrix<double, 12, 12>;

/// Deviations of a motion that nothing has told yet.
constexpr double kSpeedM_S = 15.0;
constexpr double kTurnRad_S = 0.5;
/// Kernels of a level as shares of its voxels.
constexpr float kFirstSweepKernelShare = 0.6F;
constexpr float kLastKernelShare = 0.3F;
constexpr float kFinestKernelShare = 0.15F;
constexpr float kSweepNarrowing = 0.6F;
constexpr int kMaxRounds = 8;
/// Share of the largest on the diagonal by which steps are damped.
constexpr double kDamping = 1e-4;
/// A step that moves points by less is the last on a level [m].
constexpr double kCoarselyStillM = 2e-2;
constexpr double kStillM = 1e-3;
/// Times closer together than this have no unit of their own [s].
constexpr double kLeastTimeS = 1e-3;

constexpr float kTurnS = 0.1F;
constexpr float kTurnRad = 2.0F * std::numbers::pi_v<float>;
/// About how many points tell whether a scan fits better with motion.
constexpr std::size_t kFewSweepPoints = 500;
/// What a scan must gain by it: so much for each m/s, and no more than the second. Deskewed scans
/// of simulated drives gain up to 1.06 and are never faster than 1 m/s, those of MulRan up to 1.16
/// at 3.2 m/s, those of a real map that is bent by 0.4 m up to 1.25; as recorded they gain 1.1
/// to 1.3 at 3 m/s and 1.2 to 2.3 from 5 m/s on, KITTI's at 11 m/s 1.17 to 2.
constexpr double kLeastSpeedM_S = 2.0;
constexpr double kGainPerM_S = 0.06;
constexpr double kLeastGain = 1.18;

/// Deviations as what is known.
Vector12d known() {
  Vector12d information = Vector12d::Zero();
  information.segment<3>(6).setConstant(1.0 / (kSpeedM_S * kSpeedM_S));
  information.tail<3>().setConstant(1.0 / (kTurnRad_S * kTurnRad_S));
  return information;
}

/// Units in which a step of pose and twist moves points by metres.
Vector12d units_of(const std::vector<float>& time_offsets_s) {
  double squares = 0.0;
  for (const float t : time_offsets_s) squares += static_cast<double>(t * t);
  const double time_s = std::sqrt(squares / static_cast<double>(time_offsets_s.size()));
  Vector12d units;
  units << kUnitsOfPose, kUnitsOfPose / std::max(kLeastTimeS, time_s);
  return units;
}

/// How residuals are taken in one round.
struct Round {
  const MapIndex::Level& level;
  float kernel_m = 0.0F;
  /// See `row_variance_m2`.
  float bend_share = 0.0F;
};

/// A scan with its points at the stamp, had it moved by a twist.
class Sweep {
 public:
  /// Every `stride`-th point, as it came.
  Sweep(const Query& query, std::size_t stride) {
    for (std::size_t i = 0; i < query.points.size(); i += stride) {
      raw_.positions.push_back(query.points[i]);
      raw_.time_offsets_s.push_back(query.time_offsets_s[i]);
    }
    at_stamp_ = raw_;
  }
  void move(const Vector6d& twist) {
    at_stamp_ = raw_;
    maps::deskew(at_stamp_, twist);
  }
  [[nodiscard]] std::vector<Eigen::Vector3f>& points() { return at_stamp_.positions; }

  /// Visits each residual: its point, residual [m], variance [m^2], derivative by pose and
  /// twist.
  template <typename Visit>
  void for_each_row(const Round& round, const Eigen::Isometry3d& T_index_lidar,
                    Visit&& visit) const {
    const Eigen::Isometry3f T = T_index_lidar.cast<float>();
    const auto place = [&](std::size_t i) -> Eigen::Vector3f { return T * at_stamp_.positions[i]; };
    round.level.for_each_nearest(
        at_stamp_.size(), kernel_variance_m2(round.kernel_m), place,
        [&](std::size_t i, const Eigen::Vector3f& p, const MapIndex::Level::Nearest& nearest) {
          const Voxel* voxel = sharp_match(nearest, p, round.kernel_m);
          if (voxel == nullptr) return;
          const auto add = [&](const Eigen::Vector3f& axis, float variance_m2) {
            const auto [residual_m, J_pose] =
                axis_residual(axis.cast<double>(), nearest.mean.cast<double>(), T_index_lidar,
                              at_stamp_.positions[i].cast<double>());
            Vector12d J;
            J << J_pose, static_cast<double>(raw_.time_offsets_s[i]) * J_pose;
            const float range2_m2 = at_stamp_.positions[i].squaredNorm();
            visit(i, residual_m,
                  static_cast<double>(row_variance_m2(variance_m2, range2_m2, round.bend_share)),
                  J);
          };
          add(voxel->axis0, voxel->variance0);
          if (voxel->sharp_axes == 2) add(voxel->axis1, voxel->variance1);
        });
  }

 private:
  maps::PointCloud raw_;
  maps::PointCloud at_stamp_;
};

std::size_t stride_for(const Query& query, std::size_t points) {
  return std::max<std::size_t>(1, query.points.size() / points);
}

/// A damped step of Gauss-Newton, in the unknowns' own units.
Vector12d step_of(const Sweep& sweep, const Round& round, const Eigen::Isometry3d& T_index_lidar,
                  const Vector6d& twist, const Vector12d& units) {
  Matrix12d H = known().asDiagonal();
  Vector12d gradient = Vector12d::Zero();
  gradient.tail<6>() = known().tail<6>().cwiseProduct(twist);
  const auto kernel = static_cast<double>(round.kernel_m);
  sweep.for_each_row(round, T_index_lidar,
                     [&](std::size_t, double residual_m, double variance_m2, const Vector12d& J) {
                       const double weight = robust_weight(residual_m * residual_m, kernel) /
                                             (variance_m2 + kernel_variance_m2(kernel));
                       H += J * (weight * J).transpose();
                       gradient += weight * residual_m * J;
                     });
  Matrix12d scaled = H.selfadjointView<Eigen::Lower>();
  scaled = units.asDiagonal() * scaled * units.asDiagonal();
  scaled.diagonal().array() += kDamping * scaled.diagonal().maxCoeff();
  return -units.cwiseProduct(maps::ldlt_solve(scaled, units.cwiseProduct(gradient)));
}

/// Finds twist and pose, by every `stride`-th point. @return the twist.
Vector6d find_motion(std::span<const MapIndex::Level> levels, const Query& query,
                     std::size_t stride, Eigen::Isometry3d& T_index_lidar) {
  const Vector12d units = units_of(query.time_offsets_s);
  Sweep sweep(query, stride);
  Vector6d twist = Vector6d::Zero();
  for (const MapIndex::Level& level : levels) {
    const bool finest = &level == &levels.back();
    const float last_m = (finest ? kFinestKernelShare : kLastKernelShare) * level.edge_m;
    const double still_m = finest ? kStillM : kCoarselyStillM;
    const float bend_share = finest ? 0.0F : kBendShare;
    float kernel_m = kFirstSweepKernelShare * level.edge_m;
    for (int round = 0; round < kMaxRounds; ++round) {
      kernel_m = std::max(kernel_m, last_m);
      sweep.move(twist);
      const Vector12d step =
          step_of(sweep, {level, kernel_m, bend_share}, T_index_lidar, twist, units);
      T_index_lidar = maps::renormalized(T_index_lidar * maps::exp_se3(step.head<6>()));
      twist += step.tail<6>();
      if (kernel_m <= last_m && step.cwiseQuotient(units).norm() < still_m) break;
      kernel_m *= kSweepNarrowing;
    }
  }
  return twist;
}

/// What a twist that is off does to the pose.
Matrix6d pose_covariance_of(const ClusteredSums<12>& sums, const Vector12d& units) {
  const Matrix6d twist = sums.covariance(units, known()).bottomRightCorner<6, 6>();
  const Matrix12d H = units.asDiagonal() * sums.H() * units.asDiagonal();
  // One that is off by x draws the pose by -H_pp^-1 H_pt x.
  const Matrix6d draw =
      maps::ldlt_solve(Matrix6d(H.topLeftCorner<6, 6>()), Matrix6d(H.topRightCorner<6, 6>()));
  const Matrix6d pose = draw * twist * draw.transpose();
  return kUnitsOfPose.asDiagonal() * pose * kUnitsOfPose.asDiagonal();
}

/// How a scan with some times fits best.
struct BestFit {
  /// Of points at the lever, when the sensor turns faster than it goes.
  double speed_m_s = 0.0;
  /// Sum of the weights of standing points, each up to 1: ground hardly tells of motion.
  double weight = 0.0;
};
BestFit best_fit(std::span<const MapIndex::Level> levels, const Query& query,
                 Eigen::Isometry3d T_index_lidar) {
  const std::size_t stride = stride_for(query, kFewSweepPoints);
  const Vector6d twist = find_motion(levels, query, stride, T_index_lidar);
  BestFit fit{.speed_m_s = std::max(twist.head<3>().norm(), kLeverM * twist.tail<3>().norm())};
  Sweep sweep(query, stride);
  sweep.move(twist);
  const float kernel_m = kFinestKernelShare * levels.back().edge_m;
  sweep.for_each_row({levels.back(), kernel_m}, T_index_lidar,
                     [&](std::size_t i, double residual_m, double, const Vector12d&) {
                       if (query.stands[i * stride] == 0) return;
                       fit.weight +=
                           robust_weight(residual_m * residual_m, static_cast<double>(kernel_m));
                     });
  return fit;
}

}  // namespace

bool has_times(const Query& query) {
  return std::any_of(query.time_offsets_s.begin(), query.time_offsets_s.end(),
                     [](float t) { return t != 0.0F; });
}

SweepMotion deskew(std::span<const MapIndex::Level> levels, Query& query,
                   Eigen::Isometry3d& T_index_lidar) {
  SweepMotion motion;
  if (!has_times(query)) return motion;
  motion.twist = find_motion(levels, query, 1, T_index_lidar);
  Sweep sweep(query, 1);
  sweep.move(motion.twist);
  const float kernel_m = kFinestKernelShare * levels.back().edge_m;
  ClusteredSums<12> sums(static_cast<double>(kernel_m));
  sweep.for_each_row({levels.back(), kernel_m}, T_index_lidar,
                     [&](std::size_t i, double residual_m, double variance_m2, const Vector12d& J) {
                       sums.add(T_index_lidar * sweep.points()[i].cast<double>(), residual_m,
                                variance_m2, J);
                     });
  if (sums.any()) motion.pose_covariance = pose_covariance_of(sums, units_of(query.time_offsets_s));
  query.points = std::move(sweep.points());
  return motion;
}

bool give_spinning_times(std::span<const MapIndex::Level> levels, Query& query,
                         const Eigen::Isometry3d& T_index_lidar) {
  if (!query.time_offsets_s.empty()) return false;
  Query turning = query;
  for (const Eigen::Vector3f& p : query.points)
    turning.time_offsets_s.push_back(std::atan2(p.y(), p.x()) * kTurnS / kTurnRad);
  const BestFit moving = best_fit(levels, turning, T_index_lidar);
  if (!(moving.speed_m_s > kLeastSpeedM_S)) return false;
  const double least_gain = std::min(kLeastGain, 1.0 + kGainPerM_S * moving.speed_m_s);
  Query still = query;
  still.time_offsets_s.assign(query.points.size(), 0.0F);
  if (!(moving.weight > least_gain * best_fit(levels, still, T_index_lidar).weight)) return false;
  query = std::move(turning);
  return true;
}

}  // namespace stillmap::localization
