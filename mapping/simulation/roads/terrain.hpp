#pragma once

#include <Eigen/Geometry>

#include <cstdint>
#include <optional>
#include <vector>

#include "roads/road_network.hpp"

namespace stillmap::simulation {

/// How hilly a world is.
struct Relief {
  /// Steepest grade of a hill [-]; roads follow it.
  double max_grade = 0.09;
  /// Length of its hills [m].
  double hill_length_m = 260.0;
  /// Depth of dips and bumps along a road [m], every 20 to 40 m.
  double dip_m = 0.04;
};

/// Height of the ground: hills, on which roads lie level across but for their crown, with kerbs and
/// pavements, and gardens beyond.
///
/// Hills are a sum of three waves. Their height along the roads' middle lines is spread to both
/// sides (a weighted mean of the middle lines around, on a 1 m lattice, smoothed by a quadratic
/// B-spline), so that a road on a hillside does not lean.
class Terrain {
 public:
  /// @param network  finished; must outlive the terrain. @param around  heights are asked for
  /// within `reach_m` of these points only; farther away they are those of the nearest lattice
  /// point.
  Terrain(const RoadNetwork& network, const Relief& relief, std::uint64_t seed,
          const std::vector<Eigen::Vector2d>& around, double reach_m);

  /// Height of the ground, kerbs and all [m]; roughness left out.
  [[nodiscard]] double height(const Eigen::Vector2d& p) const;
  /// The same where the place is known already.
  [[nodiscard]] double height(const Eigen::Vector2d& p, const RoadPlace& place) const;
  /// Whether the point lies on the part of the world that is there.
  [[nodiscard]] bool covers(const Eigen::Vector2d& p) const;
  [[nodiscard]] Eigen::AlignedBox2d bounds() const { return bounds_; }

  /// Frame of something on four feet, `length` and `width` apart [m]: its origin on the ground
  /// plane through them at `p`, x along `heading_rad` [rad].
  [[nodiscard]] Eigen::Isometry3d T_world_standing(const Eigen::Vector2d& p, double heading_rad,
                                                   double length_m, double width_m) const;
  /// Frame on the ground with z straight up.
  [[nodiscard]] Eigen::Isometry3d T_world_upright(const Eigen::Vector2d& p,
                                                  double heading_rad) const;

  /// Where the kerb's top edge lies, and the pavement ends, in `RoadPlace::outside_m`.
  static constexpr double kKerbWidth = 0.02;

 private:
  [[nodiscard]] double hill(const Eigen::Vector2d& p) const;
  [[nodiscard]] double along_road(const RoadEdge& edge, std::size_t point) const;
  [[nodiscard]] double base(const Eigen::Vector2d& p) const;
  void spread(const std::vector<Eigen::Vector2d>& around, double reach_m);

  const RoadNetwork& network_;
  Relief relief_;
  std::uint64_t seed_;
  Eigen::AlignedBox2d bounds_;
  std::int64_t columns_ = 0;
  std::int64_t rows_ = 0;
  /// Lattice of the spread heights; NaN where nothing is asked for.
  std::vector<float> lattice_;
};

}  // namespace stillmap::simulation
