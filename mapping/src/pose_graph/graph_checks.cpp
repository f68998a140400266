#include "pose_graph/graph_checks.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

/// How far R^T R may be from the identity; files carry rotations with some seven digits.
constexpr double kRotationTolerance = 1e-5;
/// Largest difference of mirrored entries, as a share of the deviations' product.
constexpr double kSymmetryTolerance = 1e-6;
/// Of the correlation matrix; the products of the whitened system keep half of a double's digits.
constexpr double kMinCorrelationPivot = 1e-12;

/// What is being looked at, for the message.
struct Subject {
  std::string name;

  [[noreturn]] void refuse(const std::string& why) const {
    throw std::invalid_argument(fmt::format("{}: {}", name, why));
  }
  void check_node(std::size_t node, std::size_t count) const {
    if (node >= count) refuse(fmt::format("no node {}, there are {}", node, count));
  }
  void check_pose(const Eigen::Isometry3d& T) const {
    if (!T.matrix().allFinite()) refuse("pose is not finite");
    const Eigen::Matrix3d R = T.linear();
    if (!((R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() <=
          kRotationTolerance) ||
        !(R.determinant() > 0.0))
      refuse("pose has no rotation");
  }
  void check_vector(const Eigen::Vector3d& value, const char* what) const {
    if (!value.allFinite()) refuse(fmt::format("{} is not finite", what));
  }
  template <typename Matrix>
  void check_covariance(const Matrix& covariance) const {
    if (!covariance.allFinite()) refuse("covariance is not finite");
    if (!(covariance.diagonal().minCoeff() > 0.0)) refuse("covariance is not positive definite");
    // Metres and radians apart: only correlations can be compared.
    const auto scale = covariance.diagonal().cwiseSqrt().cwiseInverse().eval();
    const Matrix correlation = scale.asDiagonal() * covariance * scale.asDiagonal();
    if (!((correlation - correlation.transpose()).cwiseAbs().maxCoeff() <= kSymmetryTolerance))
      refuse("covariance is not symmetric");
    const std::optional<Matrix> factor = maps::cholesky(correlation);
    if (!factor || !(factor->diagonal().array().square().minCoeff() >= kMinCorrelationPivot))
      refuse("covariance is not positive definite");
  }
};

}  // namespace

JoinedSets::JoinedSets(std::size_t size) : parents_(size) {
  std::iota(parents_.begin(), parents_.end(), std::size_t{0});
}

std::size_t JoinedSets::set_of(std::size_t member) {
  while (parents_[member] != member) {
    parents_[member] = parents_[parents_[member]];
    member = parents_[member];
  }
  return member;
}

void JoinedSets::join(std::size_t a, std::size_t b) {
  a = set_of(a);
  b = set_of(b);
  parents_[std::max(a, b)] = std::min(a, b);
}

void check_values(const PoseGraph& graph) {
  const std::size_t count = graph.nodes.size();
  for (std::size_t i = 0; i < count; ++i)
    Subject{fmt::format("node {}", i)}.check_pose(graph.nodes[i]);
  for (std::size_t i = 0; i < graph.relative_poses.size(); ++i) {
    const RelativePose& edge = graph.relative_poses[i];
    const Subject subject{fmt::format("relative pose {} ({} to {})", i, edge.from, edge.to)};
    subject.check_node(edge.from, count);
    subject.check_node(edge.to, count);
    if (edge.from == edge.to) subject.refuse("joins a node with itself");
    subject.check_pose(edge.T_from_to);
    subject.check_covariance(edge.covariance);
  }
  for (std::size_t i = 0; i < graph.absolute_poses.size(); ++i) {
    const AbsolutePose& pose = graph.absolute_poses[i];
    const Subject subject{fmt::format("absolute pose {} (node {})", i, pose.node)};
    subject.check_node(pose.node, count);
    subject.check_pose(pose.T_map_node);
    subject.check_covariance(pose.covariance);
  }
  for (std::size_t i = 0; i < graph.absolute_positions.size(); ++i) {
    const AbsolutePosition& position = graph.absolute_positions[i];
    const Subject subject{fmt::format("absolute position {} (node {})", i, position.node)};
    subject.check_node(position.node, count);
    subject.check_vector(position.position_map_m, "position");
    subject.check_vector(position.lever_node_m, "lever arm");
    subject.check_covariance(position.covariance);
  }
}

void check_joined(const PoseGraph& graph) {
  const std::size_t count = graph.nodes.size();
  // The map itself is one more member: what is absolute hangs together through it.
  JoinedSets sets(count + 1);
  for (const RelativePose& edge : graph.relative_poses) sets.join(edge.from, edge.to);
  for (const AbsolutePose& pose : graph.absolute_poses) sets.join(pose.node, count);
  for (const AbsolutePosition& position : graph.absolute_positions) sets.join(position.node, count);
  for (std::size_t i = 0; i < count; ++i) {
    if (sets.set_of(i) != sets.set_of(0))
      throw std::invalid_argument(
          fmt::format("pose graph in parts: nothing joins node {} to node 0", i));
  }
}

}  // namespace stillmap::mapping
