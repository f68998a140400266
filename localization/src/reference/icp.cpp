#include "reference/icp.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <fmt/format.h>
#include <Eigen/LU>

#include <stdexcept>

namespace stillmap::localization {
namespace {

constexpr int kMaxIcpIterations = 60;
/// ICP creeps: what is left to go is some 20 times the last step.
constexpr double kIcpStepM = 1e-5;

Eigen::Vector3d mean_of(std::span<const Eigen::Vector3d> points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) sum += p;
  return sum / static_cast<double>(points.size());
}

Eigen::Isometry3d step(const std::vector<Term>& terms) {
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  from.reserve(terms.size());
  to.reserve(terms.size());
  for (const Term& term : terms) {
    from.push_back(term.p_lidar);
    to.emplace_back(term.point->position.cast<double>());
  }
  return best_rigid(from, to);
}

Registration align_points(const MapPoints& map, std::span<const Eigen::Vector3f> points_lidar,
                          const Eigen::Isometry3d& T_local_lidar) {
  Registration out{.T_local_lidar = T_local_lidar, .terms = {}};
  for (;;) {
    out.terms = pair_up(map, points_lidar, out.T_local_lidar, kMaxPairDistanceM);
    if (out.terms.size() < kMinPairs) {
      out.terms.clear();
      return out;
    }
    if (out.iterations == kMaxIcpIterations) return out;
    if (out.iterations > 0 && out.last_step_m < kIcpStepM) return out;
    const Eigen::Isometry3d next = step(out.terms);
    out.last_step_m = size_m(out.T_local_lidar.inverse() * next);
    out.T_local_lidar = next;
    ++out.iterations;
  }
}

}  // namespace

Eigen::Isometry3d best_rigid(std::span<const Eigen::Vector3d> from,
                             std::span<const Eigen::Vector3d> to) {
  if (from.empty() || from.size() != to.size()) {
    throw std::invalid_argument(
        fmt::format("best_rigid: found {} and {} points, expected as many of both, at least one",
                    from.size(), to.size()));
  }
  const Eigen::Vector3d from_mean = mean_of(from);
  const Eigen::Vector3d to_mean = mean_of(to);
  Eigen::Matrix3d cross = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    cross += (to[i] - to_mean) * (from[i] - from_mean).transpose();
  }
  const maps::SingularValues svd = maps::svd_of(cross);
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();
  if (svd.U.determinant() * svd.V.determinant() < 0.0) signs.z() = -1.0;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = svd.U * signs.asDiagonal() * svd.V.transpose();
  T.translation() = to_mean - T.linear() * from_mean;
  return T;
}

const ReferenceMethod& icp() {
  static constexpr ReferenceMethod kMethod{
      .map_leaf_m = 0.5, .scan_leaf_m = 0.5, .align = align_points};
  return kMethod;
}

}  // namespace stillmap::localization
