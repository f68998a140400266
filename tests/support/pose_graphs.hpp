#pragma once

#include "pose_graph/pose_graph.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <random>
#include <vector>

namespace stillmap::test {

/// Gaussian error with these deviations [m, rad], each axis the same.
[[nodiscard]] inline Eigen::Matrix<double, 6, 6> diagonal_covariance(double sigma_m,
                                                                     double sigma_rad) {
  Eigen::Matrix<double, 6, 1> variances;
  variances << Eigen::Vector3d::Constant(sigma_m * sigma_m),
      Eigen::Vector3d::Constant(sigma_rad * sigma_rad);
  return variances.asDiagonal();
}

/// R, t and what was drawn for it: a pose off by a Gaussian error on the right.
[[nodiscard]] inline Eigen::Isometry3d disturbed(const Eigen::Isometry3d& T, double sigma_m,
                                                 double sigma_rad, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const Eigen::Vector3d shift(normal(random), normal(random), normal(random));
  const Eigen::Vector3d turn(normal(random), normal(random), normal(random));
  Eigen::Isometry3d error = Eigen::Isometry3d::Identity();
  error.translation() = sigma_m * shift;
  const double angle = sigma_rad * turn.norm();
  error.linear() = Eigen::AngleAxisd(angle, turn.normalized()).toRotationMatrix();
  return T * error;
}

/// A vehicle that turns at random at the crossings of streets `block_m` apart, in a square of
/// `blocks` streets each way, on gentle slopes; one node a metre.
struct StreetDrive {
  std::size_t nodes = 1000;
  double block_m = 50.0;
  int blocks = 6;
  std::uint64_t seed = 1;

  [[nodiscard]] std::vector<Eigen::Isometry3d> truth() const {
    std::mt19937_64 random(seed);
    std::vector<Eigen::Isometry3d> out;
    int x = blocks / 2, y = blocks / 2, heading = 0;
    const int steps_x[] = {1, 0, -1, 0}, steps_y[] = {0, 1, 0, -1};
    const auto steps = static_cast<std::size_t>(block_m);
    while (out.size() < nodes) {
      for (std::size_t step = 0; step < steps && out.size() < nodes; ++step)
        out.push_back(at(x, y, heading, static_cast<double>(step)));
      x += steps_x[heading];
      y += steps_y[heading];
      for (;;) {
        const int turn = static_cast<int>(random() % 3) - 1, next = (heading + turn + 4) % 4;
        const int to_x = x + steps_x[next], to_y = y + steps_y[next];
        if (to_x < 0 || to_y < 0 || to_x > blocks || to_y > blocks) continue;
        heading = next;
        break;
      }
    }
    return out;
  }

 private:
  [[nodiscard]] Eigen::Isometry3d at(int x, int y, int heading, double along_m) const {
    const double yaw = 0.5 * std::numbers::pi * heading;
    Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
    out.translation() << block_m * x + along_m * std::cos(yaw),
        block_m * y + along_m * std::sin(yaw), 0.0;
    out.translation().z() =
        5.0 * std::sin(0.01 * out.translation().x()) + 3.0 * std::cos(0.02 * out.translation().y());
    out.linear() = (Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                    Eigen::AngleAxisd(0.03 * std::sin(0.1 * along_m), Eigen::Vector3d::UnitY()))
                       .toRotationMatrix();
    return out;
  }
};

/// Odometry of such a drive: its noise, which covariances tell, and a bias that they do not. Some
/// 0.5 % of drift in all.
struct DriftingOdometry {
  double sigma_m = 0.01;
  double sigma_rad = 5e-4;
  double scale_bias = 0.003;
  double yaw_bias_rad_per_m = 2e-5;

  /// Consecutive edges and first guesses that follow them.
  [[nodiscard]] mapping::PoseGraph follow(const std::vector<Eigen::Isometry3d>& truth,
                                          std::mt19937_64& random) const {
    mapping::PoseGraph graph;
    graph.nodes = {truth.front()};
    for (std::size_t i = 1; i < truth.size(); ++i) {
      Eigen::Isometry3d T = truth[i - 1].inverse() * truth[i];
      const double length_m = T.translation().norm();
      T.translation() *= 1.0 + scale_bias;
      T.linear() =
          T.linear() * Eigen::AngleAxisd(yaw_bias_rad_per_m * length_m, Eigen::Vector3d::UnitZ());
      T = disturbed(T, sigma_m, sigma_rad, random);
      graph.relative_poses.push_back({i - 1, i, T, diagonal_covariance(sigma_m, sigma_rad), false});
      graph.nodes.push_back(graph.nodes.back() * T);
    }
    return graph;
  }
};

inline constexpr double kLoopSigmaM = 0.05, kLoopSigmaRad = 0.003;

[[nodiscard]] inline mapping::RelativePose loop(std::size_t from, std::size_t to,
                                                const Eigen::Isometry3d& T_from_to,
                                                std::mt19937_64& random) {
  return {from, to, disturbed(T_from_to, kLoopSigmaM, kLoopSigmaRad, random),
          diagonal_covariance(kLoopSigmaM, kLoopSigmaRad), true};
}

/// Right loops: pairs at least 100 m of driving apart that stand within 3 m; `count` of them, or as
/// many as there are, spread over the drive.
inline void add_loops(mapping::PoseGraph& graph, const std::vector<Eigen::Isometry3d>& truth,
                      std::size_t count, std::mt19937_64& random) {
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t to = 100; to < truth.size(); ++to) {
    for (std::size_t from = 0; from + 100 <= to; ++from) {
      if ((truth[from].translation() - truth[to].translation()).norm() > 3.0) continue;
      pairs.emplace_back(from, to);
      break;
    }
  }
  const std::size_t wanted = std::min(count, pairs.size());
  for (std::size_t k = 0; k < wanted; ++k) {
    const auto [from, to] = pairs[k * pairs.size() / wanted];
    graph.relative_poses.push_back(loop(from, to, truth[from].inverse() * truth[to], random));
  }
}

/// Wrong loops that agree with nothing: random pairs said to be a metre apart.
inline void add_random_wrong_loops(mapping::PoseGraph& graph,
                                   const std::vector<Eigen::Isometry3d>& truth, std::size_t count,
                                   std::mt19937_64& random) {
  while (count > 0) {
    std::size_t from = random() % truth.size(), to = random() % truth.size();
    if (from > to) std::swap(from, to);
    if (to - from < 100 || (truth[from].translation() - truth[to].translation()).norm() < 20.0)
      continue;
    Eigen::Isometry3d T = disturbed(Eigen::Isometry3d::Identity(), 1.0, 0.05, random);
    if (random() % 2 == 0)
      T.linear() = T.linear() * Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitZ());
    graph.relative_poses.push_back(loop(from, to, T, random));
    --count;
  }
}

/// Wrong loops in groups that agree with each other: one street taken for the next one.
inline void add_aliased_loops(mapping::PoseGraph& graph,
                              const std::vector<Eigen::Isometry3d>& truth, std::size_t count,
                              std::size_t group, std::mt19937_64& random) {
  const double block_m = 50.0;
  while (count > 0) {
    Eigen::Isometry3d T_shift = Eigen::Isometry3d::Identity();
    T_shift.translation()[static_cast<Eigen::Index>(random() % 2)] =
        random() % 2 == 0 ? block_m : -block_m;
    const std::size_t first_to = random() % truth.size();
    std::size_t made = 0;
    for (std::size_t to = first_to; to < truth.size() && made < std::min(group, count); to += 2) {
      const Eigen::Vector3d at = (T_shift * truth[to]).translation();
      for (std::size_t from = 0; from < truth.size(); ++from) {
        if (from + 100 > to && to + 100 > from) continue;
        if ((truth[from].translation() - at).head<2>().norm() > 3.0) continue;
        graph.relative_poses.push_back(
            loop(from, to, truth[from].inverse() * T_shift * truth[to], random));
        ++made;
        break;
      }
      if (made == 0) break;
    }
    count -= made;
  }
}

/// Root mean square of the nodes' distances to the truth, both starting at the same pose [m].
[[nodiscard]] inline double position_rmse_m(const std::vector<Eigen::Isometry3d>& nodes,
                                            const std::vector<Eigen::Isometry3d>& truth) {
  double sum = 0.0;
  for (std::size_t i = 0; i < nodes.size(); ++i)
    sum += (nodes[i].translation() - truth[i].translation()).squaredNorm();
  return std::sqrt(sum / static_cast<double>(nodes.size()));
}

}  // namespace stillmap::test
