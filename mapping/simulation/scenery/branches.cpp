#include "scenery/branches.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "scenery/parts.hpp"

namespace stillmap::simulation {
namespace {

// Weight of the way to the foot against new wood; larger values give more and straighter branches
// from the stem.
constexpr double kPathWeight = 0.35;
// Weight of starting too high for a rising branch.
constexpr double kDroopWeight = 2.0;
constexpr double kThinnestTwig_m = 0.005;
constexpr int kStemSides = 9;

}  // namespace

Branches::Branches(const std::vector<Eigen::Vector3d>& stem, const Habit& habit)
    : stem_size_(stem.size()), habit_(habit) {
  for (std::size_t i = 0; i < stem.size(); ++i) append(stem[i], i == 0 ? 0 : i - 1);
}

void Branches::append(const Eigen::Vector3d& position, std::size_t parent) {
  const bool first = nodes_.empty();
  const double path_m =
      first ? 0.0 : nodes_[parent].path_m + (position - nodes_[parent].position).norm();
  nodes_.push_back({position, parent, path_m});
}

std::size_t Branches::best_fork(const Eigen::Vector3d& tip) const {
  std::size_t best = stem_size_ - 1;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const Eigen::Vector3d way = tip - nodes_[i].position;
    if (i < stem_size_ && nodes_[i].position.z() < habit_.clear_m) continue;
    const double droop_m = std::max(0.0, habit_.rise * way.head<2>().norm() - way.z());
    const double cost = way.norm() + kPathWeight * nodes_[i].path_m + kDroopWeight * droop_m;
    if (cost < least) {
      least = cost;
      best = i;
    }
  }
  return best;
}

void Branches::grow_to(const Eigen::Vector3d& tip, Random& random) {
  const std::size_t fork = best_fork(tip);
  const Eigen::Vector3d from = nodes_[fork].position;
  const double length_m = (tip - from).norm();
  // Branches are crooked: the way's middle lies to a side, as a rule above the straight line.
  const Eigen::Vector3d aside =
      0.1 * length_m * (draw_direction(random) + 0.5 * Eigen::Vector3d::UnitZ());
  append(0.5 * (from + tip) + aside, fork);
  append(tip, nodes_.size() - 1);
}

std::vector<double> Branches::radii(double stem_radius_m) const {
  std::vector<double> tips(nodes_.size(), 0.0);
  for (std::size_t i = nodes_.size(); i-- > 0;) {
    if (tips[i] == 0.0) tips[i] = 1.0;
    if (i > 0) tips[nodes_[i].parent] += tips[i];
  }
  std::vector<double> radii_m;
  radii_m.reserve(tips.size());
  for (const double count : tips)
    radii_m.push_back(std::max(kThinnestTwig_m, stem_radius_m * std::sqrt(count / tips.front())));
  return radii_m;
}

void Branches::add_to(Mesh& mesh, double stem_radius_m, Material material) const {
  const std::vector<double> radii_m = radii(stem_radius_m);
  std::vector<TubeRing> stem;
  for (std::size_t i = 0; i < stem_size_; ++i) {
    // The foot spreads into the roots.
    const double flare = 1.0 + 0.6 * std::exp(-std::max(0.0, nodes_[i].position.z()) / 0.15);
    stem.push_back({nodes_[i].position, flare * radii_m[i], 0.08});
  }
  add_tube(mesh, stem, material, kStemSides);
  for (std::size_t i = stem_size_; i < nodes_.size(); ++i) {
    const std::size_t parent = nodes_[i].parent;
    const double foot_m = std::min(radii_m[parent], 1.3 * radii_m[i]);
    add_tube(mesh, {{nodes_[parent].position, foot_m}, {nodes_[i].position, radii_m[i]}}, material,
             radii_m[i] > 0.05 ? 5 : 3);
  }
}

}  // namespace stillmap::simulation
