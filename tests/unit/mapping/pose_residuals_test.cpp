#include "pose_graph/pose_residuals.hpp"

#include "support/matchers.hpp"

#include <stillmap/maps/frames.hpp>

#include <gtest/gtest.h>

#include <numbers>

namespace stillmap::mapping {
namespace pose_residuals_test {

using test::IsNearPose;
using test::IsNearVector;

Vector6d twist(double tx, double ty, double tz, double rx, double ry, double rz) {
  Vector6d out;
  out << tx, ty, tz, rx, ry, rz;
  return out;
}

const NodePose kFrom = node_pose(maps::exp_se3(twist(3.0, -2.0, 1.0, 0.3, -0.8, 1.9)));
const NodePose kTo = node_pose(maps::exp_se3(twist(-4.0, 5.0, 0.5, -1.1, 0.4, 0.2)));
const NodePose kMeasured = node_pose(maps::exp_se3(twist(1.0, 0.4, 0.3, 0.2, 0.1, -0.7)));
const Eigen::Vector3d kPoint(1.0, 2.0, 3.0), kLever(-0.5, 0.3, 1.5);

/// Central differences along the steps of a node.
template <int Rows, typename Function>
Eigen::Matrix<double, Rows, 6> slope(const NodePose& node, const Function& residual) {
  constexpr double kStep = 1e-6;
  Eigen::Matrix<double, Rows, 6> out;
  for (int k = 0; k < 6; ++k) {
    const Vector6d step = kStep * Vector6d::Unit(k);
    out.col(k) = (residual(node.moved(step)) - residual(node.moved(-step))) / (2.0 * kStep);
  }
  return out;
}

template <typename Matrix>
void expect_near(const Matrix& a, const Matrix& b) {
  EXPECT_LT((a - b).cwiseAbs().maxCoeff(), 1e-7) << a << "\n\n" << b;
}

TEST(PoseResiduals, StepsAreUndoneByTheirDifference) {
  for (const double scale : {0.0, 1e-9, 1e-5, 0.1, 1.0}) {
    const Vector6d step = scale * twist(4.0, -1.0, 2.0, 1.0, -2.0, 2.0);
    EXPECT_THAT(kFrom.step_to(kFrom.moved(step)), IsNearVector(step, 1e-12));
  }
  // Half a turn has two signs.
  const Vector6d half = twist(0.0, 0.0, 0.0, 0.0, 0.0, std::numbers::pi);
  EXPECT_NEAR(kFrom.step_to(kFrom.moved(half)).tail<3>().norm(), std::numbers::pi, 1e-9);
}

TEST(PoseResiduals, SmallErrorsAreThoseOfTheExponentialMap) {
  const Vector6d error = 1e-5 * twist(1.0, -2.0, 0.5, 0.3, 0.7, -1.0);
  const NodePose to = node_pose(isometry(kFrom) * isometry(kMeasured) * maps::exp_se3(error));
  EXPECT_THAT(relative_residual(kFrom, to, kMeasured).value, IsNearVector(error, 1e-9));
  const NodePose node = node_pose(isometry(kMeasured) * maps::exp_se3(error));
  EXPECT_THAT(absolute_residual(node, kMeasured).value, IsNearVector(error, 1e-9));
}

TEST(PoseResiduals, JacobiansAreTheSlopes) {
  const RelativeResidual relative = relative_residual(kFrom, kTo, kMeasured);
  expect_near(relative.J_from, slope<6>(kFrom, [](const NodePose& node) {
                return relative_residual(node, kTo, kMeasured).value;
              }));
  expect_near(relative.J_to, slope<6>(kTo, [](const NodePose& node) {
                return relative_residual(kFrom, node, kMeasured).value;
              }));
  expect_near(absolute_residual(kTo, kMeasured).J, slope<6>(kTo, [](const NodePose& node) {
                return absolute_residual(node, kMeasured).value;
              }));
  expect_near(position_residual(kTo, kPoint, kLever).J, slope<3>(kTo, [](const NodePose& node) {
                return position_residual(node, kPoint, kLever).value;
              }));
}

TEST(PoseResiduals, JacobiansHoldWhereTheErrorIsTinyOrNearlyHalfATurn) {
  for (const double angle : {0.0, 1e-4, 3.1}) {
    const NodePose to = node_pose(isometry(kFrom) * isometry(kMeasured))
                            .moved(twist(0.1, 0.2, 0.3, 0.0, angle, 0.0));
    expect_near(relative_residual(kFrom, to, kMeasured).J_to,
                slope<6>(to, [](const NodePose& node) {
                  return relative_residual(kFrom, node, kMeasured).value;
                }));
  }
}

TEST(PoseResiduals, PositionIsThatOfTheLeversEnd) {
  const NodePose node = node_pose(maps::exp_se3(twist(1, 2, 3, 0, 0, 0.5 * std::numbers::pi)));
  const Eigen::Vector3d at = node.t_map_node + Eigen::Vector3d(0, 2, 0);
  EXPECT_THAT(position_residual(node, at, {2, 0, 0}).value,
              IsNearVector(Eigen::Vector3d::Zero().eval(), 1e-12));
}

}  // namespace pose_residuals_test
}  // namespace stillmap::mapping
