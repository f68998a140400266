#include "pose_graph/first_placement.hpp"
#include "pose_graph/pose_graph.hpp"

#include "support/matchers.hpp"
#include "support/pose_graphs.hpp"

#include <gtest/gtest.h>

#include <numbers>
#include <random>
#include <vector>

namespace stillmap::mapping {
namespace pose_graph_anchors_test {

using test::IsNearPose;

const CancelFlag kGoOn = false;
const Eigen::Vector3d kLever(-0.6, 0.4, 1.2);

Eigen::Isometry3d turned(double angle_rad, const Eigen::Vector3d& axis) {
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.linear() = Eigen::AngleAxisd(angle_rad, axis.normalized()).toRotationMatrix();
  out.translation() << 300.0, -1200.0, 40.0;
  return out;
}

/// Odometry that starts in another frame, and positions that are right but for every tenth.
struct Positions {
  std::vector<Eigen::Isometry3d> truth;
  PoseGraph graph;
  std::mt19937_64 random{11};

  explicit Positions(const Eigen::Isometry3d& T_odom_map) {
    truth = test::StreetDrive{.nodes = 400, .blocks = 3, .seed = 8}.truth();
    graph = test::DriftingOdometry{}.follow(truth, random);
    for (Eigen::Isometry3d& node : graph.nodes) node = T_odom_map * node;
    std::normal_distribution<double> noise(0.0, 0.05);
    for (std::size_t i = 0; i < truth.size(); i += 4) {
      Eigen::Vector3d at = truth[i] * kLever;
      at += Eigen::Vector3d(noise(random), noise(random), noise(random));
      if (is_wrong(graph.absolute_positions.size())) at += Eigen::Vector3d(60.0, -35.0, 20.0);
      graph.absolute_positions.push_back(
          {i, at, kLever, 0.0025 * Eigen::Matrix3d::Identity(), true});
    }
  }
  static bool is_wrong(std::size_t position) { return position % 10 == 3; }
};

class AnyFrame : public ::testing::TestWithParam<double> {};

TEST_P(AnyFrame, PositionsWithGrossErrorsGeoReferenceTheGraph) {
  Positions positions(turned(GetParam(), {0.1, -0.2, 1.0}));
  const PoseGraphSolution solution = solve(positions.graph, kGoOn);
  EXPECT_LT(test::position_rmse_m(solution.nodes, positions.truth), 0.05);
  for (std::size_t i = 0; i < solution.nodes.size(); ++i)
    ASSERT_LT(test::rotation_error_rad(solution.nodes[i], positions.truth[i]), 0.02) << i;
  for (std::size_t i = 0; i < solution.position_weights.size(); ++i) {
    if (Positions::is_wrong(i))
      EXPECT_LT(solution.position_weights[i], 1e-3);
    else
      EXPECT_GT(solution.position_weights[i], 0.15);
  }
}

INSTANTIATE_TEST_SUITE_P(PoseGraph, AnyFrame, ::testing::Values(0.0, 1.0, std::numbers::pi));

TEST(PoseGraphAnchors, FirstPlacementFindsTheFrameAlone) {
  const Eigen::Isometry3d T_odom_map = turned(2.8, {0.3, 1.0, 1.0});
  Positions positions(T_odom_map);
  const auto placed = first_placement(positions.graph);
  // The odometry drifts by some metres.
  EXPECT_LT(test::position_rmse_m(placed, positions.truth), 3.0);
}

TEST(PoseGraphAnchors, StraightLineLeavesUpAsItWas) {
  PoseGraph graph;
  const Eigen::Isometry3d T_map_odom = turned(0.7, Eigen::Vector3d::UnitZ());
  std::vector<Eigen::Isometry3d> truth;
  for (std::size_t i = 0; i < 20; ++i) {
    Eigen::Isometry3d node = Eigen::Isometry3d::Identity();
    node.translation().x() = static_cast<double>(i);
    graph.nodes.push_back(node);
    truth.push_back(T_map_odom * node);
    if (i > 0)
      graph.relative_poses.push_back({i - 1, i, graph.nodes[i - 1].inverse() * node,
                                      test::diagonal_covariance(0.01, 0.001), false});
    graph.absolute_positions.push_back({i, truth.back().translation(), Eigen::Vector3d::Zero(),
                                        0.01 * Eigen::Matrix3d::Identity(), false});
  }
  const PoseGraphSolution solution = solve(graph, kGoOn);
  for (std::size_t i = 0; i < truth.size(); ++i)
    EXPECT_THAT(solution.nodes[i], IsNearPose(truth[i], 1e-6, 1e-6));
}

TEST(PoseGraphAnchors, OnePositionMovesAndDoesNotTurn) {
  PoseGraph graph;
  graph.nodes = {turned(0.5, {0, 0, 1})};
  graph.absolute_positions = {{0, {5.0, 6.0, 7.0}, kLever, Eigen::Matrix3d::Identity(), false}};
  const PoseGraphSolution solution = solve(graph, kGoOn);
  EXPECT_THAT(solution.nodes[0] * kLever, test::IsNearVector(Eigen::Vector3d(5, 6, 7), 1e-6));
  EXPECT_LT(test::rotation_error_rad(solution.nodes[0], graph.nodes[0]), 1e-6);
}

TEST(PoseGraphAnchors, AbsolutePosesPullByTheirCovariances) {
  // Two nodes 10 m apart; each is told to be elsewhere, with a fourth of the variance at the first.
  PoseGraph graph;
  graph.nodes.assign(2, Eigen::Isometry3d::Identity());
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().x() = 10.0;
  graph.relative_poses = {{0, 1, T, test::diagonal_covariance(1e-4, 1e-5), false}};
  T.translation().x() = 15.0;
  graph.absolute_poses = {{0, Eigen::Isometry3d::Identity(), test::diagonal_covariance(1.0, 1e-3)},
                          {1, T, test::diagonal_covariance(2.0, 1e-3)}};
  const PoseGraphSolution solution = solve(graph, kGoOn);
  EXPECT_NEAR(solution.nodes[0].translation().x(), 1.0, 1e-3);
  EXPECT_NEAR(solution.nodes[1].translation().x(), 11.0, 1e-3);
  EXPECT_NEAR(solution.cost, 1.0 + 4.0, 1e-5);
}

TEST(PoseGraphAnchors, AbsolutePosesGeoReferenceAnyFrame) {
  Positions positions(turned(3.0, {1.0, 0.2, 0.1}));
  positions.graph.absolute_positions.clear();
  for (const std::size_t node : {std::size_t{10}, std::size_t{350}})
    positions.graph.absolute_poses.push_back(
        {node, positions.truth[node], test::diagonal_covariance(0.05, 0.01)});
  // One position among them must not hide the poses.
  positions.graph.absolute_positions.push_back(
      {200, positions.truth[200] * kLever, kLever, 25.0 * Eigen::Matrix3d::Identity(), true});
  const PoseGraphSolution solution = solve(positions.graph, kGoOn);
  EXPECT_LT(test::position_rmse_m(solution.nodes, positions.truth), 2.0);
  EXPECT_LT(test::rotation_error_rad(solution.nodes[200], positions.truth[200]), 0.1);
}

TEST(PoseGraphAnchors, DrivesAreJoinedByTheLoopsThatAgree) {
  // Two drives through the same streets, each in a frame of its own; a fourth of the loops is
  // wrong.
  const auto truth = test::StreetDrive{.nodes = 300, .blocks = 3, .seed = 9}.truth();
  std::mt19937_64 random(12);
  PoseGraph graph = test::DriftingOdometry{}.follow(truth, random);
  const PoseGraph second = test::DriftingOdometry{}.follow(truth, random);
  const Eigen::Isometry3d T_odom_map = turned(2.9, {0.2, 0.1, -1.0});
  for (const Eigen::Isometry3d& node : second.nodes) graph.nodes.push_back(T_odom_map * node);
  for (RelativePose edge : second.relative_poses) {
    edge.from += truth.size();
    edge.to += truth.size();
    graph.relative_poses.push_back(edge);
  }
  const std::size_t first_loop = graph.relative_poses.size();
  for (std::size_t i = 5; i < 300; i += 15) {
    const bool wrong = i % 60 == 50;
    const std::size_t seen = wrong ? (i + 137) % 300 : i;
    graph.relative_poses.push_back(
        test::loop(seen, truth.size() + i, truth[i].inverse() * truth[i], random));
  }
  const PoseGraphSolution solution = solve(graph, kGoOn);
  for (std::size_t i = 0; i < truth.size(); ++i)
    ASSERT_LT(test::translation_error_m(solution.nodes[i], solution.nodes[truth.size() + i]), 0.5);
  std::size_t believed = 0;
  for (std::size_t i = first_loop; i < graph.relative_poses.size(); ++i)
    believed += solution.relative_weights[i] > 0.1 ? 1U : 0U;
  EXPECT_EQ(believed, 15U);
}

}  // namespace pose_graph_anchors_test
}  // namespace stillmap::mapping
