#include "pose_graph/graduated_solve.hpp"

namespace stillmap::mapping {
namespace {

/// The paper's is 1.4; with 2 no right measurement more was lost, in 0.6 of the time.
constexpr double kMuFactor = 2.0;
/// The next mu moves the minimum anyway; two steps each cost a quarter more for the same end.
constexpr int kStepsEach = 1;
/// Steps to the last minimum; some 20 are taken.
constexpr int kMostSteps = 200;
constexpr double kCostTolerance = 1e-9;

}  // namespace

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

}  // namespace stillmap::mapping
