#include "pose_graph/pose_graph.hpp"

#include "pose_graph/graduated_solve.hpp"
#include "pose_graph/graph_checks.hpp"
#include "pose_graph/graph_problem.hpp"

#include <utility>

namespace stillmap::mapping {

PoseGraphSolution solve(const PoseGraph& graph, const CancelFlag& cancel) {
  check_values(graph);
  check_joined(graph);
  if (cancel) throw Cancelled();
  GraphProblem problem(graph);
  const GraphProblem::Outcome outcome = solve_graduated(graph, problem, cancel);
  PoseGraphSolution out;
  out.nodes = problem.nodes();
  out.relative_weights = problem.weights().relative;
  out.position_weights = problem.weights().positions;
  out.cost = outcome.cost;
  out.iterations = outcome.iterations;
  out.converged = outcome.converged;
  return out;
}

}  // namespace stillmap::mapping
