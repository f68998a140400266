#include "registration.hpp"

#include <stillmap/maps/frames.hpp>

#include <Eigen/Eigenvalues>

#include <array>

namespace stillmap::localization {
namespace {

/// Beyond this many deviations within its surface a point lies past the surface's end.
constexpr float kMaxAlong2 = 9.0F;
/// Share of the largest eigenvalue below which a direction is not moved.
constexpr double kMinEigenvalueShare = 5e-4;
constexpr double kStepM = 1e-3;
constexpr double kStepRad = 5e-5;

constexpr float floor_of(float kernel_m) { return kernel_m * kernel_m / 9.0F; }

/// Lower triangle of H and gradient in the order that the loop fills them.
struct Sums {
  std::array<double, 21> H{};
  std::array<double, 6> gradient{};

  void add(const std::array<float, 6>& J, float residual, float weight) {
    std::size_t k = 0;
    for (std::size_t row = 0; row < 6; ++row) {
      const float weighted = weight * J[row];
      gradient[row] += static_cast<double>(weighted * residual);
      for (std::size_t column = 0; column <= row; ++column)
        H[k++] += static_cast<double>(weighted * J[column]);
    }
  }

  void store(NormalEquations& out) const {
    Eigen::Index k = 0;
    for (Eigen::Index row = 0; row < 6; ++row) {
      out.gradient[row] = gradient[static_cast<std::size_t>(row)];
      for (Eigen::Index column = 0; column <= row; ++column, ++k) {
        out.H(row, column) = out.H(column, row) = H[static_cast<std::size_t>(k)];
      }
    }
  }
};

void add_axis(const Eigen::Vector3f& axis, const Eigen::Vector3f& offset, const Eigen::Matrix3f& R,
              const Eigen::Vector3f& p_lidar, float weight, Sums& sums) {
  const Eigen::Vector3f g = R.transpose() * axis;
  const Eigen::Vector3f turn = p_lidar.cross(g);
  sums.add({g.x(), g.y(), g.z(), turn.x(), turn.y(), turn.z()}, axis.dot(offset), weight);
}

}  // namespace

AxisResidual axis_residual(const Eigen::Vector3d& axis, const Eigen::Vector3d& mean,
                           const Eigen::Isometry3d& T, const Eigen::Vector3d& p_lidar) {
  AxisResidual out;
  out.residual_m = axis.dot(T * p_lidar - mean);
  const Eigen::Vector3d g = T.linear().transpose() * axis;
  out.jacobian << g, p_lidar.cross(g);
  return out;
}

PointTerm match_point(const MapIndex::Level& level, const Eigen::Vector3f& p, float kernel_m) {
  const float floor_m2 = floor_of(kernel_m);
  const MapIndex::Level::Nearest nearest = level.nearest(p, floor_m2);
  if (nearest.voxel == nullptr || nearest.voxel->sharp_axes == 0) return {};
  const Voxel& voxel = *nearest.voxel;
  const Eigen::Vector3f offset = p - voxel.mean;
  const float a = voxel.axis0.dot(offset);
  const float b = voxel.sharp_axes == 2 ? voxel.axis1.dot(offset) : 0.0F;
  const float across2 = a * a / (voxel.variance0 + floor_m2) + b * b / (voxel.variance1 + floor_m2);
  if (!(nearest.distance2 - across2 < kMaxAlong2)) return {};
  const float kernel2 = kernel_m * kernel_m;
  const float distance2 = a * a + b * b;
  const float share = kernel2 / (kernel2 + distance2);
  return {&voxel, distance2, share * share};
}

NormalEquations linearize(const MapIndex::Level& level,
                          std::span<const Eigen::Vector3f> points_lidar,
                          const Eigen::Isometry3d& T_index_lidar, const Focus& focus) {
  const Eigen::Matrix3f R = T_index_lidar.linear().cast<float>();
  const Eigen::Vector3f t = T_index_lidar.translation().cast<float>();
  const float kernel2 = focus.kernel_m * focus.kernel_m;
  NormalEquations out;
  Sums sums;
  for (std::size_t i = 0; i < points_lidar.size(); i += focus.stride) {
    const Eigen::Vector3f& p_lidar = points_lidar[i];
    const Eigen::Vector3f p = R * p_lidar + t;
    const PointTerm term = match_point(level, p, focus.kernel_m);
    if (term.voxel == nullptr) {
      out.cost += static_cast<double>(kernel2);
      continue;
    }
    ++out.matched;
    out.cost += static_cast<double>(kernel2 * term.distance2_m2 / (kernel2 + term.distance2_m2));
    const Voxel& voxel = *term.voxel;
    const Eigen::Vector3f offset = p - voxel.mean;
    const auto weight = [&](float variance) {
      return term.robust_weight /
             residual_variance_m2(variance, focus.kernel_m, p_lidar.squaredNorm());
    };
    add_axis(voxel.axis0, offset, R, p_lidar, weight(voxel.variance0), sums);
    if (voxel.sharp_axes == 2)
      add_axis(voxel.axis1, offset, R, p_lidar, weight(voxel.variance1), sums);
  }
  sums.store(out);
  return out;
}

Matrix6d in_metres(const Matrix6d& H) {
  Vector6d scale;
  scale << 1.0, 1.0, 1.0, 1.0 / kLeverM, 1.0 / kLeverM, 1.0 / kLeverM;
  return scale.asDiagonal() * H * scale.asDiagonal();
}

int refine(const MapIndex::Level& level, std::span<const Eigen::Vector3f> points_lidar,
           const Focus& focus, int max_iterations, Eigen::Isometry3d& T_index_lidar) {
  for (int iteration = 1; iteration <= max_iterations; ++iteration) {
    const NormalEquations system = linearize(level, points_lidar, T_index_lidar, focus);
    if (system.matched < 6) return iteration;
    const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(in_metres(system.H));
    const Vector6d& values = solver.eigenvalues();
    Vector6d gradient = system.gradient;
    gradient.tail<3>() /= kLeverM;
    Vector6d along = solver.eigenvectors().transpose() * gradient;
    for (Eigen::Index k = 0; k < 6; ++k) {
      along[k] = values[k] > kMinEigenvalueShare * values[5] ? -along[k] / values[k] : 0.0;
    }
    Vector6d step = solver.eigenvectors() * along;
    step.tail<3>() /= kLeverM;
    T_index_lidar = maps::renormalized(T_index_lidar * maps::exp_se3(step));
    if (step.head<3>().norm() < kStepM && step.tail<3>().norm() < kStepRad) return iteration;
  }
  return max_iterations;
}

}  // namespace stillmap::localization
