#include "pose_graph/graduated_solve.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

namespace stillmap::mapping {
namespace {

double env(const char* name, double fallback) {
  const char* text = std::getenv(name);
  return text ? std::atof(text) : fallback;
}

constexpr double kPoseBound = 22.46;
constexpr double kPositionBound = 16.27;

struct Doubt {
  double* weight;
  double ratio;
};

std::vector<Doubt> doubts(const PoseGraph& graph, GraphProblem& problem) {
  std::vector<Doubt> out;
  for (std::size_t i = 0; i < graph.relative_poses.size(); ++i)
    if (graph.relative_poses[i].doubtful)
      out.push_back(
          {&problem.weights().relative[i], problem.relative_chi_squared(i) / kPoseBound});
  for (std::size_t i = 0; i < graph.absolute_positions.size(); ++i)
    if (graph.absolute_positions[i].doubtful)
      out.push_back(
          {&problem.weights().positions[i], problem.position_chi_squared(i) / kPositionBound});
  return out;
}

}  // namespace

GraphProblem::Outcome solve_graduated(const PoseGraph& graph, GraphProblem& problem,
                                      const CancelFlag& cancel) {
  const double factor = env("GNC_FACTOR", 1.4);
  const int inner = static_cast<int>(env("GNC_INNER", 2));
  const int method = static_cast<int>(env("GNC_METHOD", 0));
  const double mu_cap = env("GNC_CAP", 1e300);
  const bool verbose = env("GNC_V", 0) > 0;
  std::vector<Doubt> list = doubts(graph, problem);
  if (list.empty()) return problem.minimize(100, 1e-12, cancel);
  int iterations = 0;
  double worst = 0.0;
  for (const Doubt& d : list) worst = std::max(worst, d.ratio);
  double mu = std::clamp(2.0 * worst, 1.0, mu_cap);
  if (method == 1) mu = worst > 0.5 ? 1.0 / std::max(2.0 * worst - 1.0, 1e-3) : 1e3;
  for (int round = 0; round < 200; ++round) {
    double change = 0.0;
    int half = 0;
    for (Doubt& d : doubts(graph, problem)) {
      double w = 1.0;
      if (method == 0) {
        w = mu / (mu + d.ratio);
        w *= w;
      } else {
        if (d.ratio >= (mu + 1) / mu)
          w = 0.0;
        else if (d.ratio > mu / (mu + 1))
          w = std::sqrt(mu * (mu + 1) / d.ratio) - mu;
      }
      change = std::max(change, std::abs(w - *d.weight));
      *d.weight = w;
      half += w > 0.5;
    }
    const auto outcome = problem.minimize(inner, 1e-6, cancel);
    iterations += outcome.iterations;
    if (verbose)
      std::fprintf(stderr, "round %d mu %.3g cost %.6g it %d change %.3g half %d\n", round, mu,
                   outcome.cost, outcome.iterations, change, half);
    if (method == 0) {
      if (mu <= 1.0 && change < 1e-3) break;
      mu = std::max(1.0, mu / factor);
    } else {
      if (mu > 1e4 || (mu > 10 && change < 1e-3)) break;
      mu *= factor;
    }
  }
  auto last = problem.minimize(100, 1e-10, cancel);
  last.iterations += iterations;
  return last;
}

}  // namespace stillmap::mapping
