#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <vector>

#include "geometry/mesh.hpp"
#include "geometry/random.hpp"

namespace stillmap::simulation {

/// Wood of a plant: a stem, and branches that grow out of it towards given points. A new branch
/// leaves the wood where that costs least wood and the shortest way to the foot (after Cuntz,
/// Forstner, Borst, Haeusser, "One rule to grow them all", PLoS Comput. Biol. 2010), so that
/// branches of several orders come about.
class Branches {
 public:
  struct Habit {
    /// Height over the foot [m] below which the stem stays bare.
    double clear_m;
    /// How far branches rise per metre outwards.
    double rise;
  };

  /// @param stem  from the foot upwards, at least 2 points [m].
  Branches(const std::vector<Eigen::Vector3d>& stem, const Habit& habit);

  /// To be called with near points first.
  void grow_to(const Eigen::Vector3d& tip, Random& random);
  /// The cross section of wood stays the same over each fork, so it follows the number of tips
  /// (Leonardo's rule).
  void add_to(Mesh& mesh, double stem_radius_m, Material material) const;

 private:
  struct Node {
    Eigen::Vector3d position;
    std::size_t parent;
    double path_m;
  };

  [[nodiscard]] std::size_t best_fork(const Eigen::Vector3d& tip) const;
  [[nodiscard]] std::vector<double> radii(double stem_radius_m) const;
  void append(const Eigen::Vector3d& position, std::size_t parent);

  std::vector<Node> nodes_;
  std::size_t stem_size_;
  Habit habit_;
};

}  // namespace stillmap::simulation
