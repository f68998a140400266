#pragma once

#include "pose_graph/pose_graph.hpp"
#include "pose_graph/pose_residuals.hpp"

#include <memory>
#include <vector>

namespace stillmap::mapping {

/// A graph as Ceres minimizes it: squared whitened residuals, those of doubtful measurements under
/// a graduated Geman-McClure loss (Yang, Antonante, Tzoumas, Carlone, "Graduated Non-Convexity for
/// Robust Spatial Perception", RA-L 2020) with a bound c for what noise explains,
///
///     mu c^2 s / (mu c^2 + s),  s the squared whitened residual,
///
/// which is Geman-McClure's at mu = 1 and nearly s at a large mu.
class GraphProblem {
 public:
  /// @param graph  checked.  @param start  T_map_node of each node.
  GraphProblem(const PoseGraph& graph, const std::vector<Eigen::Isometry3d>& start);
  ~GraphProblem();
  GraphProblem(const GraphProblem&) = delete;
  GraphProblem& operator=(const GraphProblem&) = delete;

  struct Outcome {
    int iterations = 0;
    bool converged = false;
  };
  /// Moves the nodes to the minimum, or that way.
  /// @param cost_tolerance  relative change of the cost below which it is reached.
  /// @throws Cancelled.
  Outcome minimize(int max_iterations, double cost_tolerance, const CancelFlag& cancel);

  /// Of the doubtful measurements' loss, from the next `minimize` on; at least 1.
  void set_mu(double mu);
  /// The largest s / c^2 of a doubtful measurement; 0 when there is none.
  [[nodiscard]] double worst_doubt() const;
  /// The loss' slope at each measurement, (mu c^2 / (mu c^2 + s))^2; 1 when it is not doubtful.
  [[nodiscard]] std::vector<double> relative_weights() const;
  [[nodiscard]] std::vector<double> absolute_weights() const;
  [[nodiscard]] std::vector<double> position_weights() const;
  /// As in `PoseGraphSolution`.
  [[nodiscard]] double cost() const;
  [[nodiscard]] std::vector<Eigen::Isometry3d> nodes() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace stillmap::mapping
