#pragma once

#include "evaluation/labels/true_ground.hpp"

#include <stillmap/mapping/label_evaluation.hpp>
#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/map_object.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Heights of points over the true surface.
class TrueHeights {
 public:
  /// @param origin        of the map.
  /// @param T_truth_map   along the path, with the path's places [m, from the origin]; the nearest
  ///                      one holds for a point. At least one.
  TrueHeights(const DriveTruth& truth, const Eigen::Vector3d& origin,
              std::vector<Eigen::Vector3f> path, std::vector<Eigen::Isometry3d> T_truth_map);

  /// @param p  from the map's origin [m]. @return over the true surface [m]; nothing beside it.
  [[nodiscard]] std::optional<double> over_surface(const Eigen::Vector3d& p) const;
  /// Horizontal distance to the nearest place of the path [m].
  [[nodiscard]] double path_distance(const Eigen::Vector3d& p) const;

 private:
  [[nodiscard]] std::size_t nearest_place(const Eigen::Vector3d& p) const;

  const DriveTruth& truth_;
  Eigen::Vector3d origin_;
  std::vector<Eigen::Vector3f> path_;
  std::vector<Eigen::Isometry3d> T_truth_map_;
  /// Poses of the map are the true ones: no place matters.
  bool same_everywhere_ = true;
};

/// Where a removed object stood, seen from above [m, from the map's origin].
struct Footprint {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  /// Unit, along the length.
  Eigen::Vector2d heading = Eigen::Vector2d::UnitX();
  double half_length = 0.0;
  double half_width = 0.0;
  /// Of the box [m].
  double bottom = 0.0;
  bool moving = false;

  [[nodiscard]] bool contains(const Eigen::Vector2d& p, double margin_m = 0.0) const;
};
/// One a placement of every object that points were removed of.
[[nodiscard]] std::vector<Footprint> footprints_of(const std::vector<maps::MapObject>& objects,
                                                   const Eigen::Vector3d& origin);

/// Whether the true surface in a footprint has a step of more than 8 cm: neighbours 0.1 m apart
/// differ by more (slopes of streets stay below 2 cm).
[[nodiscard]] bool is_across_step(const Footprint& footprint, const TrueHeights& heights);

/// Footprints found by place.
class FootprintIndex {
 public:
  explicit FootprintIndex(std::vector<Footprint> footprints);
  /// @param visit  index of each footprint that contains the point, grown by at most 0.5 m.
  void for_each_at(const Eigen::Vector2d& p, double margin_m,
                   const std::function<void(std::size_t)>& visit) const;
  [[nodiscard]] const std::vector<Footprint>& footprints() const { return footprints_; }

 private:
  std::vector<Footprint> footprints_;
  maps::CellMap<std::vector<std::uint32_t>> cells_;
};

/// Counts the cells of parked objects' footprints that have ground at its true height.
class FootprintGround {
 public:
  /// Cells whose middle lies in a footprint of an object that was not moving, and on the true
  /// surface.
  FootprintGround(const std::vector<Footprint>& footprints, const TrueHeights& heights);

  /// @param p  a ground point of the map, from its origin [m].
  void add(const Eigen::Vector3d& p, bool filled, const TrueHeights& heights);
  [[nodiscard]] GroundUnder all() const;
  /// By distance from the path: 10, 25, 50 m, and all beyond.
  [[nodiscard]] std::vector<GroundUnderBand> bands() const;

 private:
  struct Cell {
    /// Number of its band.
    std::uint8_t band = 0;
    /// What was met, as bits.
    std::uint8_t met = 0;
  };
  maps::CellMap<Cell> cells_;
};

/// Median and 95th percentile of heights' sizes [m].
[[nodiscard]] HeightErrors height_errors(std::vector<double> heights_m);

}  // namespace stillmap::mapping
