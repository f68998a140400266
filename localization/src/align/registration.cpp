#include "registration.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>

namespace stillmap::localization {
namespace {

/// Beyond this many deviations within its surface a point lies past the surface's end.
constexpr float kMaxAlong2 = 9.0F;
/// Share of the largest eigenvalue below which a direction is not moved.
constexpr double kMinEigenvalueShare = 5e-4;
constexpr double kStepM = 1e-3;
constexpr double kStepRad = 5e-5;

constexpr int kMaxSteps = 4;
/// Share of the kernel by which a point may move before it is looked up again.
constexpr float kSlackShare = 0.1F;
/// Factor by which the kernel narrows from round to round.
constexpr float kNarrowing = 0.6F;

bool is_small(const Vector6d& step) {
  return step.head<3>().norm() < kStepM && step.tail<3>().norm() < kStepRad;
}

/// Rows and columns of the rotations divided by the lever.
Matrix6d rotations_by_lever(const Matrix6d& matrix) {
  return kUnitsOfPose.asDiagonal() * matrix * kUnitsOfPose.asDiagonal();
}

/// @return steps taken; moves the pose until the held matches agree.
int descend(const ResidualRows& rows, float kernel_m, Eigen::Isometry3d& T_index_lidar) {
  for (int step_count = 1; step_count <= kMaxSteps; ++step_count) {
    const Vector6d step =
        bounded_step(linearize(rows, T_index_lidar, kernel_m), kMinEigenvalueShare);
    T_index_lidar = maps::renormalized(T_index_lidar * maps::exp_se3(step));
    if (is_small(step)) return step_count;
  }
  return kMaxSteps;
}

}  // namespace

const Voxel* sharp_match(const MapIndex::Level::Nearest& nearest, const Eigen::Vector3f& p,
                         float kernel_m) {
  const float floor_m2 = kernel_variance_m2(kernel_m);
  if (nearest.voxel == nullptr || nearest.voxel->sharp_axes == 0) return nullptr;
  const Voxel& voxel = *nearest.voxel;
  const Eigen::Vector3f offset = p - nearest.mean;
  const float a = voxel.axis0.dot(offset);
  const float b = voxel.sharp_axes == 2 ? voxel.axis1.dot(offset) : 0.0F;
  const float across2 = a * a / (voxel.variance0 + floor_m2) + b * b / (voxel.variance1 + floor_m2);
  return nearest.distance2 - across2 < kMaxAlong2 ? &voxel : nullptr;
}

Matches::Matches(const MapIndex::Level& level, std::span<const Eigen::Vector3f> points_lidar,
                 std::size_t stride)
    : level_(level),
      points_lidar_(points_lidar),
      stride_(stride),
      matches_((points_lidar.size() + stride - 1) / stride) {}

const ResidualRows& Matches::at(const Eigen::Isometry3d& T_index_lidar, float kernel_m,
                                float bend_share) {
  const Eigen::Matrix3f R = T_index_lidar.linear().cast<float>();
  const Eigen::Vector3f t = T_index_lidar.translation().cast<float>();
  const float slack_m = kSlackShare * kernel_m;
  const auto place = [&](std::size_t i) -> Eigen::Vector3f {
    return R * points_lidar_[i * stride_] + t;
  };
  moved_.resize(matches_.size());
  std::size_t moved_count = 0;
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    moved_[moved_count] = i;
    moved_count += (place(i) - matches_[i].at).squaredNorm() < slack_m * slack_m ? 0 : 1;
  }
  level_.for_each_nearest(
      moved_count, kernel_variance_m2(kernel_m), [&](std::size_t k) { return place(moved_[k]); },
      [&](std::size_t k, const Eigen::Vector3f& p, const MapIndex::Level::Nearest& nearest) {
        matches_[moved_[k]] = {sharp_match(nearest, p, kernel_m), nearest.mean, p};
      });
  rows_.clear(t.cast<double>());
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    const Eigen::Vector3f& p_lidar = points_lidar_[i * stride_];
    const Match& match = matches_[i];
    if (match.voxel == nullptr) continue;
    const Voxel& voxel = *match.voxel;
    const Eigen::Vector3f mean = match.mean - t;
    const float range2 = p_lidar.squaredNorm();
    rows_.add(p_lidar, voxel.axis0, voxel.axis0.dot(mean),
              row_variance_m2(voxel.variance0, range2, bend_share));
    if (voxel.sharp_axes == 2) {
      rows_.add(p_lidar, voxel.axis1, voxel.axis1.dot(mean),
                row_variance_m2(voxel.variance1, range2, bend_share));
    }
  }
  rows_.pad();
  return rows_;
}

int refine(const MapIndex::Level& level, std::span<const Eigen::Vector3f> points_lidar,
           const Schedule& schedule, Eigen::Isometry3d& T_index_lidar) {
  Matches matches(level, points_lidar, schedule.stride);
  float kernel_m = schedule.first_kernel_m;
  int steps = 0;
  for (int round = 0; round < schedule.max_rounds; ++round) {
    kernel_m = std::max(kernel_m, schedule.last_kernel_m);
    const ResidualRows& rows = matches.at(T_index_lidar, kernel_m, schedule.bend_share);
    if (rows.count < 6) break;
    const Eigen::Isometry3d before = T_index_lidar;
    steps += descend(rows, kernel_m, T_index_lidar);
    const bool at_last = kernel_m <= schedule.last_kernel_m;
    if (at_last && is_small(maps::log_se3(before.inverse() * T_index_lidar))) break;
    kernel_m *= kNarrowing;
  }
  return steps;
}

Matrix6d in_metres(const Matrix6d& H) { return rotations_by_lever(H); }

Matrix6d out_of_metres(const Matrix6d& covariance) { return rotations_by_lever(covariance); }

Vector6d bounded_step(const NormalEquations& system, double min_eigenvalue_share) {
  const maps::SymmetricEigen<6> eigen = maps::eigen_of(in_metres(system.H));
  const Vector6d& values = eigen.values;
  Vector6d gradient = system.gradient;
  gradient.tail<3>() /= kLeverM;
  Vector6d along = eigen.vectors.transpose() * gradient;
  for (Eigen::Index k = 0; k < 6; ++k) {
    along[k] = values[k] > min_eigenvalue_share * values[5] ? -along[k] / values[k] : 0.0;
  }
  Vector6d step = eigen.vectors * along;
  step.tail<3>() /= kLeverM;
  return step;
}

}  // namespace stillmap::localization
