#include "pose_graph/pose_graph.hpp"

#include "support/matchers.hpp"
#include "support/pose_graphs.hpp"
#include "support/throws.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace stillmap::mapping {
namespace pose_graph_test {

using test::IsNearPose;
using test::ThrowsSaying;

const CancelFlag kGoOn = false;

Eigen::Isometry3d pose(double x, double y, double z, double yaw_rad = 0.0) {
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.translation() << x, y, z;
  out.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return out;
}

/// Some rotation about some axis.
Eigen::Isometry3d skewed_pose() {
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.translation() << 120.0, -45.0, 8.0;
  out.linear() =
      Eigen::AngleAxisd(2.5, Eigen::Vector3d(1.0, -2.0, 0.5).normalized()).toRotationMatrix();
  return out;
}

/// Five corners of a square, the last one on the first; each edge is 10 m and turns left.
PoseGraph square() {
  PoseGraph graph;
  graph.nodes = {pose(0, 0, 0), pose(10, 0, 0, 0.5 * std::numbers::pi),
                 pose(10, 10, 0, std::numbers::pi), pose(0, 10, 0, -0.5 * std::numbers::pi),
                 pose(0, 0, 0)};
  for (std::size_t i = 0; i + 1 < graph.nodes.size(); ++i)
    graph.relative_poses.push_back({i, i + 1, graph.nodes[i].inverse() * graph.nodes[i + 1],
                                    test::diagonal_covariance(0.1, 0.01), false});
  return graph;
}

/// A kilometre of streets with loops; the odometry drifts.
struct Streets {
  std::vector<Eigen::Isometry3d> truth;
  PoseGraph graph;
  std::size_t first_loop = 0;
  std::size_t first_wrong = 0;
  std::mt19937_64 random;

  explicit Streets(std::uint64_t seed, std::size_t loops)
      : truth(test::StreetDrive{.nodes = 500, .blocks = 3, .seed = seed}.truth()), random(seed) {
    graph = test::DriftingOdometry{}.follow(truth, random);
    first_loop = graph.relative_poses.size();
    test::add_loops(graph, truth, loops, random);
    first_wrong = graph.relative_poses.size();
  }
};

TEST(PoseGraph, TwoEdgesReachTheWeightedOptimumFromAnyStart) {
  for (const double start : {-100.0, 0.0, 0.5, 1.0, 3.0, 1e4}) {
    PoseGraph graph;
    graph.nodes = {pose(0, 0, 0), pose(start, -0.3 * start, 2.0, 0.001 * start)};
    graph.relative_poses = {
        {0, 1, pose(0, 0, 0), Eigen::Matrix<double, 6, 6>::Identity() / 1000.0, false},
        {0, 1, pose(1, 0, 0), Eigen::Matrix<double, 6, 6>::Identity(), false}};
    const PoseGraphSolution solution = solve(graph, kGoOn);
    EXPECT_THAT(solution.nodes[0], IsNearPose(pose(0, 0, 0), 0.0, 0.0));
    EXPECT_THAT(solution.nodes[1], IsNearPose(pose(1.0 / 1001.0, 0, 0), 1e-8, 1e-8)) << start;
    EXPECT_NEAR(solution.cost, 1000.0 / 1001.0, 1e-9);
    EXPECT_TRUE(solution.converged);
  }
}

TEST(PoseGraph, LoopOfASquareSharesItsErrorAmongTheEdges) {
  // The last edge is told 0.4 m too long. Along x two equal edges of 0.1 m share it with the loop,
  // which is sure: no turn helps.
  PoseGraph graph = square();
  for (RelativePose& edge : graph.relative_poses) {
    edge.covariance = test::diagonal_covariance(0.1, 1e-6);
  }
  graph.relative_poses[3].T_from_to.translation().x() += 0.4;
  graph.relative_poses.push_back(
      {0, 4, pose(0, 0, 0), test::diagonal_covariance(1e-5, 1e-6), false});
  const PoseGraphSolution solution = solve(graph, kGoOn);
  // Each of the four edges takes a quarter, along the direction of the error (-y in the map).
  EXPECT_THAT(solution.nodes[1], IsNearPose(pose(10, 0.1, 0, 0.5 * std::numbers::pi), 1e-4, 1e-5));
  EXPECT_THAT(solution.nodes[2], IsNearPose(pose(10, 10.2, 0, std::numbers::pi), 1e-4, 1e-5));
  EXPECT_THAT(solution.nodes[3], IsNearPose(pose(0, 10.3, 0, -0.5 * std::numbers::pi), 1e-4, 1e-5));
  EXPECT_THAT(solution.nodes[4], IsNearPose(pose(0, 0, 0), 1e-4, 1e-5));
  EXPECT_NEAR(solution.cost, 4.0, 1e-3);
}

TEST(PoseGraph, LeavesAnExactGraph) {
  const PoseGraph graph = square();
  const PoseGraphSolution solution = solve(graph, kGoOn);
  for (std::size_t i = 0; i < graph.nodes.size(); ++i)
    EXPECT_THAT(solution.nodes[i], IsNearPose(graph.nodes[i], 1e-12, 1e-12));
  EXPECT_NEAR(solution.cost, 0.0, 1e-12);
  EXPECT_TRUE(solution.converged);
}

TEST(PoseGraph, ComesBackToAnExactGraphFromAWrongStart) {
  const PoseGraph exact = square();
  PoseGraph graph = exact;
  std::mt19937_64 random(3);
  for (std::size_t i = 1; i < graph.nodes.size(); ++i)
    graph.nodes[i] = test::disturbed(graph.nodes[i], 5.0, 0.7, random);
  const PoseGraphSolution solution = solve(graph, kGoOn);
  for (std::size_t i = 0; i < graph.nodes.size(); ++i)
    EXPECT_THAT(solution.nodes[i], IsNearPose(exact.nodes[i], 1e-7, 1e-8));
}

TEST(PoseGraph, FollowsARigidMotionOfEverything) {
  Streets streets(4, 40);
  const Eigen::Isometry3d T_other_map = skewed_pose();
  PoseGraph moved = streets.graph;
  for (Eigen::Isometry3d& node : moved.nodes) node = T_other_map * node;
  const PoseGraphSolution a = solve(streets.graph, kGoOn), b = solve(moved, kGoOn);
  for (std::size_t i = 0; i < a.nodes.size(); ++i)
    ASSERT_THAT(b.nodes[i], IsNearPose(T_other_map * a.nodes[i], 1e-4, 1e-6));
  EXPECT_NEAR(a.cost, b.cost, 1e-4 * a.cost);
}

TEST(PoseGraph, GivesTheSameBitsTwice) {
  const Streets streets(5, 20);
  const PoseGraphSolution a = solve(streets.graph, kGoOn), b = solve(streets.graph, kGoOn);
  for (std::size_t i = 0; i < a.nodes.size(); ++i)
    ASSERT_EQ(a.nodes[i].matrix(), b.nodes[i].matrix());
  EXPECT_EQ(a.relative_weights, b.relative_weights);
}

TEST(PoseGraph, KeepsRightLoopsThoughOdometryDrifted) {
  Streets streets(6, 40);
  const PoseGraphSolution solution = solve(streets.graph, kGoOn);
  for (std::size_t i = 0; i < streets.first_loop; ++i) EXPECT_EQ(solution.relative_weights[i], 1.0);
  for (std::size_t i = streets.first_loop; i < solution.relative_weights.size(); ++i)
    EXPECT_GT(solution.relative_weights[i], 0.1);
  EXPECT_LT(test::position_rmse_m(solution.nodes, streets.truth),
            0.7 * test::position_rmse_m(streets.graph.nodes, streets.truth));
}

TEST(PoseGraph, KeepsARightLoopTenMetresOffTheFirstGuess) {
  // A square of 2 km whose heading drifts by 0.1 degrees in 100 m: its end lies 0.5 % off.
  PoseGraph graph;
  std::vector<Eigen::Isometry3d> truth{pose(0, 0, 0)};
  graph.nodes = {pose(0, 0, 0)};
  for (std::size_t i = 1; i <= 2000; ++i) {
    const bool corner = i % 500 == 0;
    const double turn_rad = corner ? 0.5 * std::numbers::pi : 0.0;
    truth.push_back(truth.back() * pose(1, 0, 0, turn_rad));
    const Eigen::Isometry3d T = pose(1, 0, 0, turn_rad + 1.6e-5);
    graph.nodes.push_back(graph.nodes.back() * T);
    graph.relative_poses.push_back({i - 1, i, T, test::diagonal_covariance(0.02, 5e-4), false});
  }
  ASSERT_GT(test::translation_error_m(graph.nodes.back(), truth.back()), 10.0);
  graph.relative_poses.push_back(
      {0, 2000, pose(0, 0, 0), test::diagonal_covariance(0.05, 0.003), true});
  const PoseGraphSolution solution = solve(graph, kGoOn);
  EXPECT_GT(solution.relative_weights.back(), 0.5);
  EXPECT_LT(test::translation_error_m(solution.nodes.back(), truth.back()), 0.2);
}

class WrongLoops : public ::testing::TestWithParam<std::size_t> {};

TEST_P(WrongLoops, ThirtyPercentAreRejectedAndTheRightOnesKept) {
  Streets streets(7, 42);
  const PoseGraphSolution without = solve(streets.graph, kGoOn);
  PoseGraph graph = streets.graph;
  if (GetParam() == 1)
    test::add_random_wrong_loops(graph, streets.truth, 18, streets.random);
  else
    test::add_aliased_loops(graph, streets.truth, 18, GetParam(), streets.random);
  ASSERT_EQ(graph.relative_poses.size() - streets.first_wrong, 18U);
  ASSERT_EQ(streets.first_wrong - streets.first_loop, 42U);
  const PoseGraphSolution solution = solve(graph, kGoOn);
  for (std::size_t i = streets.first_loop; i < streets.first_wrong; ++i)
    EXPECT_NEAR(solution.relative_weights[i], without.relative_weights[i], 0.05);
  for (std::size_t i = streets.first_wrong; i < graph.relative_poses.size(); ++i)
    EXPECT_LT(solution.relative_weights[i], 1e-3);
  EXPECT_NEAR(test::position_rmse_m(solution.nodes, streets.truth),
              test::position_rmse_m(without.nodes, streets.truth), 0.02);
}

/// Wrong loops that agree with each other: each alone, threes and sixes.
INSTANTIATE_TEST_SUITE_P(PoseGraph, WrongLoops, ::testing::Values(1U, 3U, 6U));

TEST(PoseGraph, TrustsAnEdgeThatIsNotDoubtful) {
  PoseGraph graph = square();
  graph.relative_poses.push_back(
      {0, 4, pose(3, 0, 0), test::diagonal_covariance(0.01, 0.01), false});
  const PoseGraphSolution solution = solve(graph, kGoOn);
  EXPECT_EQ(solution.relative_weights.back(), 1.0);
  EXPECT_THAT(solution.nodes[4], IsNearPose(pose(3, 0, 0), 0.05, 0.05));
}

TEST(PoseGraph, DirectionThatAnEdgeDoesNotTellIsLeftToTheOthers) {
  // A tunnel: the scans know all but the way along it, where another edge does know it.
  Eigen::Matrix<double, 6, 1> variances;
  variances << 1e6, 1e-4, 1e-4, 1e-6, 1e-6, 1e-6;
  PoseGraph graph;
  graph.nodes = {pose(0, 0, 0), pose(0, 0, 0)};
  graph.relative_poses = {
      {0, 1, pose(0.0, 0.1, 0, 0.02), variances.asDiagonal(), false},
      {0, 1, pose(7.0, 5.0, 3.0, 0.5), test::diagonal_covariance(10.0, 10.0), false}};
  const PoseGraphSolution solution = solve(graph, kGoOn);
  // Along the sure edge's x axis the unsure one counts, elsewhere not.
  const Eigen::Isometry3d T_sure = pose(0.0, 0.1, 0, 0.02).inverse() * solution.nodes[1];
  EXPECT_NEAR(T_sure.translation().x(), 7.1, 0.1);
  EXPECT_NEAR(T_sure.translation().y(), 0.0, 1e-3);
  EXPECT_NEAR(T_sure.translation().z(), 0.0, 1e-3);
  EXPECT_LT(test::rotation_error_rad(T_sure, Eigen::Isometry3d::Identity()), 1e-3);
}

TEST(PoseGraph, GivesBackAGraphOfOneNodeOrNone) {
  EXPECT_TRUE(solve({}, kGoOn).nodes.empty());
  PoseGraph one;
  one.nodes = {skewed_pose()};
  EXPECT_THAT(solve(one, kGoOn).nodes.at(0), IsNearPose(skewed_pose(), 1e-12, 1e-12));
}

TEST(PoseGraph, RefusesWhatCannotBeMeasured) {
  const auto refused = [](const auto& spoil, const std::vector<std::string>& texts) {
    PoseGraph graph = square();
    graph.absolute_poses.push_back({2, graph.nodes[2], test::diagonal_covariance(1.0, 0.1)});
    graph.absolute_positions.push_back({3, {}, {}, Eigen::Matrix3d::Identity(), true});
    spoil(graph);
    EXPECT_THAT([&] { (void)solve(graph, kGoOn); }, ThrowsSaying<std::invalid_argument>(texts));
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refused([&](PoseGraph& g) { g.nodes[1].translation().x() = nan; }, {"node 1", "not finite"});
  refused([&](PoseGraph& g) { g.nodes[1].linear() *= 1.01; }, {"node 1", "rotation"});
  refused([](PoseGraph& g) { g.relative_poses[2].to = 9; },
          {"relative pose 2 (2 to 9)", "no node 9, there are 5"});
  refused([](PoseGraph& g) { g.relative_poses[2].to = 2; }, {"relative pose 2 (2 to 2)", "itself"});
  refused([](PoseGraph& g) { g.relative_poses[0].T_from_to.linear().col(2) *= -1.0; },
          {"relative pose 0 (0 to 1)", "rotation"});
  refused([](PoseGraph& g) { g.relative_poses[0].covariance(3, 3) = 0.0; },
          {"relative pose 0 (0 to 1)", "positive definite"});
  refused([](PoseGraph& g) { g.relative_poses[0].covariance(0, 1) = 0.005; },
          {"relative pose 0 (0 to 1)", "symmetric"});
  refused(
      [](PoseGraph& g) {
        g.relative_poses[0].covariance(0, 1) = g.relative_poses[0].covariance(1, 0) = 0.02;
      },
      {"relative pose 0 (0 to 1)", "positive definite"});
  refused([&](PoseGraph& g) { g.relative_poses[0].covariance(4, 1) = nan; },
          {"relative pose 0 (0 to 1)", "covariance is not finite"});
  refused([](PoseGraph& g) { g.absolute_poses[0].node = 5; },
          {"absolute pose 0 (node 5)", "no node 5"});
  refused([](PoseGraph& g) { g.absolute_poses[0].covariance.setZero(); },
          {"absolute pose 0 (node 2)", "positive definite"});
  refused([](PoseGraph& g) { g.absolute_positions[0].node = 5; },
          {"absolute position 0 (node 5)", "no node 5"});
  refused([&](PoseGraph& g) { g.absolute_positions[0].position_map_m.z() = nan; },
          {"absolute position 0 (node 3)", "position is not finite"});
  refused([&](PoseGraph& g) { g.absolute_positions[0].lever_node_m.z() = nan; },
          {"absolute position 0 (node 3)", "lever arm is not finite"});
  refused([](PoseGraph& g) { g.absolute_positions[0].covariance(0, 0) = -1.0; },
          {"absolute position 0 (node 3)", "positive definite"});
}

TEST(PoseGraph, RefusesPartsThatNothingJoins) {
  PoseGraph graph = square();
  graph.relative_poses.erase(graph.relative_poses.begin() + 2);
  EXPECT_THAT([&] { (void)solve(graph, kGoOn); },
              ThrowsSaying<std::invalid_argument>({"in parts", "node 3"}));
  // Each part is somewhere in the map: that joins them.
  for (const std::size_t node : {std::size_t{1}, std::size_t{4}})
    graph.absolute_poses.push_back({node, graph.nodes[node], test::diagonal_covariance(1.0, 0.1)});
  EXPECT_THAT(solve(graph, kGoOn).nodes[3],
              IsNearPose(pose(0, 10, 0, -0.5 * std::numbers::pi), 1e-6, 1e-6));
  graph.absolute_poses.pop_back();
  EXPECT_THROW((void)solve(graph, kGoOn), std::invalid_argument);
}

TEST(PoseGraph, EndsWhenCancelled) {
  EXPECT_THROW((void)solve(square(), CancelFlag(true)), Cancelled);
}

}  // namespace pose_graph_test
}  // namespace stillmap::mapping
