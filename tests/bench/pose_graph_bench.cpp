// What a pose graph costs, and what wrong loops do to it.
//
//   pose_graph_bench [--nodes N] [--loops N] [--blocks N] [--wrong SHARE] [--group N] [--seed S]
//   [--repeat N]
//
// A drive through a grid of streets (`blocks` of 50 m each way), one keyframe a metre, odometry
// that drifts by 0.5 %; of the loops, `wrong` is a share that leads to other places: random ones
// (--group 1), or in groups that agree with each other (one street taken for the next). Prints the
// time on the wall and of the processor (the fastest repeat), and the positions' error before,
// after, and without wrong loops.

#include "pose_graph/pose_graph.hpp"

#include "support/pose_graphs.hpp"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <exception>
#include <random>
#include <vector>

namespace stillmap::test {
namespace {

struct Request {
  std::size_t nodes = 5000;
  std::size_t loops = 500;
  int blocks = 6;
  double wrong = 0.1;
  std::size_t group = 1;
  std::uint64_t seed = 1;
  int repeat = 3;
};

struct Seconds {
  double wall = 0.0;
  double cpu = 0.0;
};

Seconds now() {
  timespec cpu{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
  return {
      std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(),
      static_cast<double>(cpu.tv_sec) + 1e-9 * static_cast<double>(cpu.tv_nsec)};
}

void measure(const Request& request) {
  const auto truth =
      StreetDrive{.nodes = request.nodes, .blocks = request.blocks, .seed = request.seed}.truth();
  std::mt19937_64 random(request.seed);
  mapping::PoseGraph right = DriftingOdometry{}.follow(truth, random);
  const std::size_t chain = right.relative_poses.size();
  const auto wrong =
      static_cast<std::size_t>(std::lround(request.wrong * static_cast<double>(request.loops)));
  add_loops(right, truth, request.loops - wrong, random);
  const std::size_t first_wrong = right.relative_poses.size();
  mapping::PoseGraph graph = right;
  if (request.group == 1)
    add_random_wrong_loops(graph, truth, wrong, random);
  else
    add_aliased_loops(graph, truth, wrong, request.group, random);
  const mapping::CancelFlag cancel = false;
  const mapping::PoseGraphSolution without = mapping::solve(right, cancel);
  mapping::PoseGraphSolution solution;
  Seconds best{1e9, 1e9};
  for (int k = 0; k < request.repeat; ++k) {
    const Seconds begin = now();
    solution = mapping::solve(graph, cancel);
    const Seconds end = now();
    best.wall = std::min(best.wall, end.wall - begin.wall);
    best.cpu = std::min(best.cpu, end.cpu - begin.cpu);
  }
  std::size_t lost = 0, believed = 0;
  double least_right = 1.0, most_wrong = 0.0;
  for (std::size_t i = chain; i < graph.relative_poses.size(); ++i) {
    const double weight = solution.relative_weights[i];
    (i < first_wrong ? lost : believed) += i < first_wrong ? weight < 0.25 : weight >= 0.25;
    if (i < first_wrong)
      least_right = std::min(least_right, weight);
    else
      most_wrong = std::max(most_wrong, weight);
  }
  fmt::print(
      "{} keyframes, {} right loops ({} lost, least weight {:.3f}), {} wrong ({} believed, "
      "most weight {:.2g})\n",
      request.nodes, first_wrong - chain, lost, least_right,
      graph.relative_poses.size() - first_wrong, believed, most_wrong);
  fmt::print("error: odometry {:.3f} m, solved {:.3f} m, without wrong loops {:.3f} m\n",
             position_rmse_m(graph.nodes, truth), position_rmse_m(solution.nodes, truth),
             position_rmse_m(without.nodes, truth));
  fmt::print("{:.2f} s on the wall, {:.2f} s of processor, {} iterations, converged: {}\n",
             best.wall, best.cpu, solution.iterations, solution.converged);
}

}  // namespace
}  // namespace stillmap::test

int main(int argc, char** argv) {
  stillmap::test::Request request;
  CLI::App app("What a pose graph costs, and what wrong loops do to it.");
  app.add_option("--nodes", request.nodes)->check(CLI::Range(200, 1000000));
  app.add_option("--loops", request.loops);
  app.add_option("--blocks", request.blocks, "of 50 m, each way")->check(CLI::Range(1, 1000));
  app.add_option("--wrong", request.wrong, "share of the loops")->check(CLI::Range(0.0, 1.0));
  app.add_option("--group", request.group, "wrong loops that agree; 1 for none");
  app.add_option("--seed", request.seed);
  app.add_option("--repeat", request.repeat)->check(CLI::Range(1, 1000));
  CLI11_PARSE(app, argc, argv);
  try {
    stillmap::test::measure(request);
  } catch (const std::exception& error) {
    fmt::print(stderr, "pose_graph_bench: {}\n", error.what());
    return 1;
  }
}
