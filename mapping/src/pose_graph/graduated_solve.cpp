#include "pose_graph/graduated_solve.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>

namespace stillmap::mapping {
namespace {

double env(const char* name, double fallback) {
  const char* text = std::getenv(name);
  return text ? std::atof(text) : fallback;
}

}  // namespace

GraphProblem::Outcome solve_graduated(GraphProblem& problem, const CancelFlag& cancel) {
  const double factor = env("GNC_FACTOR", 1.4);
  const int inner = static_cast<int>(env("GNC_INNER", 2));
  int iterations = 0;
  for (double mu = 2.0 * problem.worst_doubt(); mu > 1.0; mu /= factor) {
    problem.set_mu(mu);
    iterations += problem.minimize(inner, 1e-4, cancel).iterations;
    if (std::getenv("GNC_V"))
      std::fprintf(stderr, "mu %.3g it %d cost %g\n", mu, iterations, problem.cost());
  }
  problem.set_mu(1.0);
  GraphProblem::Outcome last = problem.minimize(100, 1e-9, cancel);
  last.iterations += iterations;
  return last;
}

}  // namespace stillmap::mapping
