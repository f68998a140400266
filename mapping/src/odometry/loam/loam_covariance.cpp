#include "odometry/loam/loam_covariance.hpp"

#include <Eigen/Cholesky>

#include <algorithm>

namespace stillmap::mapping::loam {
namespace {

/// Features near each other share the errors of the map, so they tell less than as many independent
/// ones. A cautious guess: with it the steps of simulated town drives had a NEES of 0.2 to 0.6 (6
/// expected).
constexpr double kDependence = 30.0;
/// Variance of one distance, at least [m^2].
constexpr double kMinVarianceM2 = 0.01 * 0.01;
/// How fast a vehicle's speeds change [m/s^2, rad/s^2 at kLeverM].
constexpr double kAccelerationMS2 = 4.0;
constexpr double kMinPredictionM = 0.05;

}  // namespace

Matrix6 covariance_of(const MapMatch* match, double period_s, int predicted) {
  const double off_m =
      std::max(kMinPredictionM, kAccelerationMS2 * period_s * period_s * (1.0 + predicted));
  Eigen::Matrix<double, 6, 1> s;
  s << Eigen::Vector3d::Ones(), Eigen::Vector3d::Constant(1.0 / kLeverM);
  // What a prediction tells, in metres everywhere, and what the match adds along what it tells.
  Matrix6 information = Matrix6::Identity() / (off_m * off_m);
  if (match != nullptr) {
    Matrix6 told = Matrix6::Identity();
    if (match->told) {
      for (const auto& v : match->told->untold) told -= v * v.transpose();
    }
    const double variance = kDependence * std::max(kMinVarianceM2, match->variance_m2);
    const Matrix6 seen = s.asDiagonal() * match->information * s.asDiagonal();
    information += told * seen * told / variance;
  }
  const Matrix6 covariance = s.asDiagonal() * information.inverse() * s.asDiagonal();
  return 0.5 * (covariance + covariance.transpose());
}

}  // namespace stillmap::mapping::loam
