#include "sensing/imu_model.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <sstream>
#include <string>
#include <vector>

namespace stillmap::simulation {
namespace imu_model_test {

/// Specific forces of three seconds, without errors.
std::vector<Eigen::Vector3d> forces(const std::function<Eigen::Isometry3d(double)>& path) {
  ImuModel model;
  model.force_noise = model.force_offset_mps2 = model.force_walk = 0.0;
  const auto clock = [](double time_s) { return std::llround(1e9 * time_s); };
  std::istringstream lines(imu_csv(model, path, clock, 3.0, 1));
  std::string line;
  std::getline(lines, line);
  std::vector<Eigen::Vector3d> all;
  while (std::getline(lines, line)) {
    double value[7] = {};
    std::istringstream fields(line);
    for (double& each : value) {
      fields >> each;
      fields.ignore();
    }
    all.emplace_back(value[4], value[5], value[6]);
  }
  return all;
}

/// Speeds up by 2 m/s^2 to the left, and jumps forward after 1.5 s.
auto jumping(double jump_m) {
  return [jump_m](double time_s) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = Eigen::Vector3d(time_s > 1.501 ? jump_m : 0.0, time_s * time_s, 0.0);
    return T;
  };
}

TEST(ImuModel, TellsGravityAndAcceleration) {
  const std::vector<Eigen::Vector3d> all = forces(jumping(0.0));
  ASSERT_GT(all.size(), 600U);
  for (const Eigen::Vector3d& force : all)
    EXPECT_LT((force - Eigen::Vector3d(0.0, 2.0, 9.81)).norm(), 1e-3);
}

TEST(ImuModel, MillimetresOfAPathAreNoBlow) {
  for (const Eigen::Vector3d& force : forces(jumping(0.006))) EXPECT_LT(force.norm(), 20.0);
}

TEST(ImuModel, ReadingsEndAt24G) {
  double most = 0.0;
  for (const Eigen::Vector3d& force : forces(jumping(1.0)))
    most = std::max(most, force.cwiseAbs().maxCoeff());
  EXPECT_DOUBLE_EQ(most, 235.4);
}

}  // namespace imu_model_test
}  // namespace stillmap::simulation
