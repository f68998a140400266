#pragma once

#include <stillmap/mapping/progress.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Measured motion between two nodes. Covariances: rows tx ty tz [m], rx ry rz [rad], perturbation
/// on the right (T exp(x)); positive definite.
struct RelativePose {
  std::size_t from = 0;
  std::size_t to = 0;
  Eigen::Isometry3d T_from_to = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
  /// May be plainly wrong (a loop): weighs less the less the rest agrees.
  bool doubtful = false;
};

/// Where a node is believed to be.
struct AbsolutePose {
  std::size_t node = 0;
  Eigen::Isometry3d T_map_node = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
  /// May be plainly wrong (a jump of a trajectory).
  bool doubtful = false;
};

/// A measured position alone, as of GNSS.
struct AbsolutePosition {
  std::size_t node = 0;
  /// Of the point `lever_node_m` of the node.
  Eigen::Vector3d position_map_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d lever_node_m = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
  /// May be plainly wrong (multipath).
  bool doubtful = false;
};

struct PoseGraph {
  /// First guesses, T_map_node. Without any absolute pose or position the first one stays fixed.
  /// With them, or between parts that only doubtful edges join (drives), any frame will do: parts
  /// are first placed as a whole.
  std::vector<Eigen::Isometry3d> nodes;
  std::vector<RelativePose> relative_poses;
  std::vector<AbsolutePose> absolute_poses;
  std::vector<AbsolutePosition> absolute_positions;
};

struct PoseGraphSolution {
  std::vector<Eigen::Isometry3d> nodes;
  /// One a relative pose, in [0, 1]: how much of a doubtful one is believed; 1 for the others.
  /// Noise as its covariance tells leaves 0.6 on average, seldom less than 0.25; errors that
  /// nothing agrees with are near 0.
  std::vector<double> relative_weights;
  /// One an absolute pose, the same.
  std::vector<double> absolute_weights;
  /// One an absolute position, the same.
  std::vector<double> position_weights;
  /// Sum of the squared whitened residuals, doubtful ones by their weights.
  double cost = 0.0;
  int iterations = 0;
  bool converged = false;
};

/// Maximum-likelihood poses; doubtful measurements under Geman-McClure's loss (pose_graph.md).
/// The same input gives the same bits. One thread.
/// @throws std::invalid_argument naming an edge with an unknown node, a number that is not finite,
/// a rotation that is none, or a covariance that is not positive definite, or parts of the graph
/// that nothing joins; Cancelled.
[[nodiscard]] PoseGraphSolution solve(const PoseGraph& graph, const CancelFlag& cancel);

}  // namespace stillmap::mapping
