#include "odometry/loam/motion_fit.hpp"

#include <stillmap/maps/median.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace stillmap::mapping::loam {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;

/// A direction is told when its eigenvalue is this share of the number of correspondences: the mean
/// square of the cosines between normals and the direction.
constexpr double kMinEigenvalueShare = 5e-3;
constexpr int kSteps = 4;
constexpr double kFirstDamping = 1e-4;
/// Steps below these end a fit [m], [rad].
constexpr double kSettledM = 5e-4;
constexpr double kSettledRad = 5e-5;
/// Tuning constant of the bisquare for 95 % efficiency on Gaussian noise.
constexpr double kBisquare = 4.685;
/// The weights reach at most so far [m].
constexpr double kMaxReachM = 3.0;

struct Normal {
  Matrix6 H = Matrix6::Zero();
  Vector6 g = Vector6::Zero();
};

/// Distances at T.
std::vector<double> distances(std::span<const Correspondence> all, const Motion& T) {
  std::vector<double> d(all.size());
  PartOfMotion part(T);
  for (std::size_t i = 0; i < all.size(); ++i) {
    part.go_to(all[i].share);
    d[i] = all[i].surface.distance(part * all[i].X);
  }
  return d;
}

std::vector<double> bisquare_weights(std::span<const Correspondence> all,
                                     const std::vector<double>& d, double least_m) {
  const double reach =
      std::clamp(kBisquare * maps::kMedianToDeviation * maps::median(d), least_m, kMaxReachM);
  std::vector<double> weights(d.size());
  for (std::size_t i = 0; i < d.size(); ++i) {
    const double u = d[i] / reach;
    weights[i] = u < 1.0 ? all[i].surface.weight * (1.0 - u * u) * (1.0 - u * u) : 0.0;
  }
  return weights;
}

double cost_of(const std::vector<double>& d, const std::vector<double>& weights) {
  double cost = 0.0;
  for (std::size_t i = 0; i < d.size(); ++i) cost += weights[i] * d[i] * d[i];
  return cost;
}

Normal linearize(std::span<const Correspondence> all, const Motion& T,
                 const std::vector<double>* weights) {
  Normal normal;
  PartOfMotion part(T);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double w = weights == nullptr ? 1.0 : (*weights)[i];
    if (!(w > 0.0)) continue;
    const Correspondence& c = all[i];
    part.go_to(c.share);
    const Eigen::Vector3d off = part * c.X - c.surface.point;
    const Eigen::Matrix<double, 3, 6> dX = part.jacobian(c.X);
    for (int row = 0; row < c.surface.rows; ++row) {
      const Eigen::Vector3d& n = c.surface.normals[static_cast<std::size_t>(row)];
      const Vector6 J = dX.transpose() * n;
      normal.H.noalias() += w * J * J.transpose();
      normal.g.noalias() += w * n.dot(off) * J;
    }
  }
  return normal;
}

/// Units of the six coordinates, for metres everywhere.
Vector6 scale() {
  Vector6 s;
  s << Eigen::Vector3d::Ones(), Eigen::Vector3d::Constant(1.0 / kLeverM);
  return s;
}

/// Eq. (12) within the told directions.
Vector6 damped_step(const Normal& normal, const Told& told, double damping) {
  const Vector6 s = scale();
  const Matrix6 H = s.asDiagonal() * normal.H * s.asDiagonal();
  Eigen::MatrixXd A = told.directions.transpose() * H * told.directions;
  A.diagonal() *= 1.0 + damping;
  const Eigen::VectorXd b = told.directions.transpose() * (s.asDiagonal() * normal.g);
  return -(s.asDiagonal() * (told.directions * A.ldlt().solve(b)));
}

bool small(const Vector6& step) {
  return step.head<3>().norm() < kSettledM && step.tail<3>().norm() < kSettledRad;
}

void describe(MotionFit& fit, std::span<const Correspondence> all,
              const std::vector<double>& weights) {
  const std::vector<double> d = distances(all, fit.T);
  const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
  fit.information = linearize(all, fit.T, &weights).H;
  fit.variance_m2 = sum > 0.0 ? cost_of(d, weights) / sum : 0.0;
}

}  // namespace

std::size_t inliers(std::span<const Correspondence> correspondences, const Motion& T) {
  const std::vector<double> d = distances(correspondences, T);
  return static_cast<std::size_t>(
      std::count_if(d.begin(), d.end(), [](double x) { return x < kInlierM; }));
}

Told told_by(std::span<const Correspondence> correspondences, const Motion& T) {
  const Vector6 s = scale();
  const Matrix6 H = s.asDiagonal() * linearize(correspondences, T, nullptr).H * s.asDiagonal();
  const maps::SymmetricEigen<6> eigen = maps::eigen_of(H);
  const double least = kMinEigenvalueShare * static_cast<double>(correspondences.size());
  Told told;
  Eigen::Index first = 0;
  while (first < 6 && !(eigen.values[first] > least)) {
    told.untold.emplace_back(eigen.vectors.col(first));
    ++first;
  }
  told.directions = eigen.vectors.rightCols(6 - first);
  return told;
}

MotionFit fit_motion(std::span<const Correspondence> correspondences, const Motion& T,
                     const Told& told, double reach_m) {
  MotionFit fit;
  fit.T = T;
  if (correspondences.size() < 6 || told.directions.cols() == 0) return fit;
  const std::vector<double> weights = bisquare_weights(
      correspondences, distances(correspondences, T), std::min(reach_m, kMaxReachM));
  double damping = kFirstDamping;
  double cost = cost_of(distances(correspondences, T), weights);
  for (int k = 0; k < kSteps; ++k) {
    const Vector6 step = damped_step(linearize(correspondences, fit.T, &weights), told, damping);
    if (!step.allFinite()) break;
    const Motion tried = fit.T + step;
    const double tried_cost = cost_of(distances(correspondences, tried), weights);
    if (tried_cost <= cost) {
      fit.T = tried;
      cost = tried_cost;
      damping *= 0.1;
    } else {
      damping *= 10.0;
    }
    if (small(step)) break;
  }
  fit.settled = small(fit.T - T);
  describe(fit, correspondences, weights);
  return fit;
}

}  // namespace stillmap::mapping::loam
