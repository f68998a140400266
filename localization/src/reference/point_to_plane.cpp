#include "reference/point_to_plane.hpp"

#include "align/registration.hpp"

#include <stillmap/maps/frames.hpp>

#include <array>

namespace stillmap::localization {
namespace {

/// Widths of the robust kernel [m], and rounds with each.
constexpr std::array<double, 3> kKernelsM = {1.0, 0.5, 0.2};
constexpr int kMaxIterations = 20;
constexpr double kStillStepM = 1e-3;
/// The last kernel goes on until the answer stands still.
constexpr double kLastStepM = 1e-4;
/// Directions with less than this share of the largest eigenvalue are not moved along.
constexpr double kLeastEigenvalueShare = 1e-4;

/// Pairs with a surface, weighted by a Geman-McClure kernel.
std::vector<Term> weighted_pairs(const MapPoints& map,
                                 std::span<const Eigen::Vector3f> points_lidar,
                                 const Eigen::Isometry3d& T, double kernel_m) {
  const double kernel2 = kernel_m * kernel_m;
  std::vector<Term> terms;
  terms.reserve(points_lidar.size());
  for (Term& term : pair_up(map, points_lidar, T, kMaxPairDistanceM)) {
    if (term.point->sharp_axes == 0) continue;
    term.residual.setZero();
    for (int k = 0; k < term.point->sharp_axes; ++k) {
      const Eigen::Vector3d axis = term.point->axes[static_cast<std::size_t>(k)].cast<double>();
      term.residual += axis.dot(term.offset) * axis;
    }
    const double ratio = kernel2 / (kernel2 + term.residual.squaredNorm());
    term.weight = ratio * ratio;
    terms.push_back(term);
  }
  return terms;
}

NormalEquations system_of(const std::vector<Term>& terms, const Eigen::Isometry3d& T) {
  NormalEquations system;
  for (const Term& term : terms) {
    for (int k = 0; k < term.point->sharp_axes; ++k) {
      const AxisResidual r =
          axis_residual(term.point->axes[static_cast<std::size_t>(k)].cast<double>(),
                        term.point->position.cast<double>(), T, term.p_lidar);
      system.H += term.weight * r.jacobian * r.jacobian.transpose();
      system.gradient += term.weight * r.residual_m * r.jacobian;
    }
  }
  return system;
}

Registration align_surfaces(const MapPoints& map, std::span<const Eigen::Vector3f> points_lidar,
                            const Eigen::Isometry3d& T_local_lidar) {
  Registration out{.T_local_lidar = T_local_lidar, .terms = {}};
  for (const double kernel_m : kKernelsM) {
    const double enough_m = kernel_m == kKernelsM.back() ? kLastStepM : kStillStepM;
    for (int round = 0; round < kMaxIterations; ++round) {
      out.terms = weighted_pairs(map, points_lidar, out.T_local_lidar, kernel_m);
      if (out.terms.size() < kMinPairs) {
        out.terms.clear();
        return out;
      }
      const NormalEquations system = system_of(out.terms, out.T_local_lidar);
      const Eigen::Isometry3d move = maps::exp_se3(bounded_step(system, kLeastEigenvalueShare));
      out.last_step_m = size_m(move);
      out.T_local_lidar = maps::renormalized(out.T_local_lidar * move);
      ++out.iterations;
      if (out.last_step_m < enough_m) break;
    }
  }
  out.terms = weighted_pairs(map, points_lidar, out.T_local_lidar, kKernelsM.back());
  return out;
}

}  // namespace

const ReferenceMethod& point_to_plane() {
  static constexpr ReferenceMethod kMethod{
      .map_leaf_m = 0.25, .scan_leaf_m = 0.5, .align = align_surfaces};
  return kMethod;
}

}  // namespace stillmap::localization
