#include "pose_graph/pose_graph.hpp"

#include "pose_graph/first_placement.hpp"
#include "pose_graph/graduated_solve.hpp"
#include "pose_graph/graph_checks.hpp"
#include "pose_graph/graph_problem.hpp"

#include <utility>

namespace stillmap::mapping {

PoseGraphSolution solve(const PoseGraph& graph, const CancelFlag& cancel) {
  check_values(graph);
  check_joined(graph);
  if (cancel) throw Cancelled();
  GraphProblem problem(graph, first_placement(graph));
  const GraphProblem::Outcome outcome = solve_graduated(problem, cancel);
  PoseGraphSolution out;
  out.nodes = problem.nodes();
  out.relative_weights = problem.relative_weights();
  out.absolute_weights = problem.absolute_weights();
  out.position_weights = problem.position_weights();
  out.cost = problem.cost();
  out.iterations = outcome.iterations;
  out.converged = outcome.converged;
  return out;
}

}  // namespace stillmap::mapping
