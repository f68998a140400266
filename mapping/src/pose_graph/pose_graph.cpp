#include "pose_graph/pose_graph.hpp"

#include "pose_graph/first_placement.hpp"
#include "pose_graph/graph_checks.hpp"
#include "pose_graph/graph_problem.hpp"

#include <utility>

namespace stillmap::mapping {
namespace {

/// The paper's is 1.4; with 2 no right measurement more was lost, in 0.6 of the time.
constexpr double kMuFactor = 2.0;
/// The next mu moves the minimum anyway; two steps each cost a quarter more for the same end.
constexpr int kStepsEach = 1;
/// Steps to the last minimum; some 20 are taken.
constexpr int kMostSteps = 200;
constexpr double kCostTolerance = 1e-9;

/// The minimum under Geman-McClure's loss, mu of the graduated one coming down to 1 by and by, so
/// that first guesses far off (drift of metres at a loop of centimetres) lose no right measurement.
GraphProblem::Outcome solve_graduated(GraphProblem& problem, const CancelFlag& cancel) {
  int iterations = 0;
  // The loss is convex there at the worst measurement too; the paper starts so.
  for (double mu = 2.0 * problem.worst_doubt(); mu > 1.0; mu /= kMuFactor) {
    problem.set_mu(mu);
    iterations += problem.minimize(kStepsEach, kCostTolerance, cancel).iterations;
  }
  problem.set_mu(1.0);
  GraphProblem::Outcome last = problem.minimize(kMostSteps, kCostTolerance, cancel);
  last.iterations += iterations;
  return last;
}

}  // namespace

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
