#pragma once

#include "pose_graph/pose_graph.hpp"
#include "pose_graph/pose_residuals.hpp"

#include <memory>
#include <vector>

namespace stillmap::mapping {

/// How much each measurement counts, 1 for those that are not doubtful.
struct GraphWeights {
  std::vector<double> relative;
  std::vector<double> positions;
};

/// Least squares over a graph by Ceres: whitened residuals, analytic Jacobians, sparse Cholesky.
class GraphProblem {
 public:
  /// @param graph  checked; lives longer.
  explicit GraphProblem(const PoseGraph& graph);
  ~GraphProblem();
  GraphProblem(const GraphProblem&) = delete;
  GraphProblem& operator=(const GraphProblem&) = delete;

  struct Outcome {
    /// As in `PoseGraphSolution`.
    double cost = 0.0;
    int iterations = 0;
    bool converged = false;
  };
  /// Moves the nodes to the minimum, or that way. @throws Cancelled.
  Outcome minimize(int max_iterations, double cost_tolerance, const CancelFlag& cancel);

  /// Of the next `minimize`.
  [[nodiscard]] GraphWeights& weights();
  /// Squared whitened residuals, not weighted.
  [[nodiscard]] double relative_chi_squared(std::size_t index) const;
  [[nodiscard]] double position_chi_squared(std::size_t index) const;
  [[nodiscard]] std::vector<Eigen::Isometry3d> nodes() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace stillmap::mapping
