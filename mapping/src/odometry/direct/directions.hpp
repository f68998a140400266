#pragma once

#include <Eigen/Core>

#include <vector>

/// Motions (tx ty tz rx ry rz) [m, rad] and directions that a scan does not tell, rotations counted
/// in metres at `kLeverM`.
namespace stillmap::mapping {

/// What is left of a motion without its parts along some directions.
[[nodiscard]] Eigen::Matrix<double, 6, 1> without(
    const Eigen::Matrix<double, 6, 1>& motion,
    const std::vector<Eigen::Matrix<double, 6, 1>>& directions);

/// Covariance of a match, but along some directions that of the prediction.
[[nodiscard]] Eigen::Matrix<double, 6, 6> with_predicted(
    const Eigen::Matrix<double, 6, 6>& match,
    const std::vector<Eigen::Matrix<double, 6, 1>>& directions,
    const Eigen::Matrix<double, 6, 6>& prediction);

}  // namespace stillmap::mapping
