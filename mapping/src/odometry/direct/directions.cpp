#include "odometry/direct/directions.hpp"

#include "odometry/lever.hpp"

namespace stillmap::mapping {

Eigen::Matrix<double, 6, 1> without(const Eigen::Matrix<double, 6, 1>& motion,
                                    const std::vector<Eigen::Matrix<double, 6, 1>>& directions) {
  Eigen::Matrix<double, 6, 1> left = in_metres(motion);
  for (const Eigen::Matrix<double, 6, 1>& direction : directions)
    left -= direction.dot(left) * direction;
  left.tail<3>() /= kLeverM;
  return left;
}

Eigen::Matrix<double, 6, 6> with_predicted(
    const Eigen::Matrix<double, 6, 6>& match,
    const std::vector<Eigen::Matrix<double, 6, 1>>& directions,
    const Eigen::Matrix<double, 6, 6>& prediction) {
  Eigen::Matrix<double, 6, 6> kept = Eigen::Matrix<double, 6, 6>::Identity();
  for (const Eigen::Matrix<double, 6, 1>& direction : directions)
    kept -= direction * direction.transpose();
  const Eigen::Matrix<double, 6, 6> rest = Eigen::Matrix<double, 6, 6>::Identity() - kept;
  const Eigen::Matrix<double, 6, 6> in_m = kept * rotations_times(match, kLeverM) * kept +
                                           rest * rotations_times(prediction, kLeverM) * rest;
  return rotations_times(0.5 * (in_m + in_m.transpose()), 1.0 / kLeverM);
}

}  // namespace stillmap::mapping
