#pragma once

#include "index/index_window.hpp"
#include "index/place_rows.hpp"
#include "query.hpp"

#include <Eigen/Geometry>

#include <cstddef>
#include <limits>
#include <numbers>
#include <span>
#include <vector>

namespace stillmap::localization {

/// Where in a map a scan may have been taken, from all places that the map was seen from.
///
/// Counts how many of the scan's standing points fall into occupied cells of the map, as
/// `search_poses` does, in three rounds: every place and heading on widely spread cells, the best
/// of these on 2 m cells, the best of those on 1 m cells. Unlike a descriptor of what a scan sees
/// from a place, it does not mind what hides part of the view, nor which sensor it is. Turned down:
/// Scan Context (Kim, Kim, IROS 2018), whose bins compare what the map holds behind walls with what
/// the scan cannot see there.
class PlaceSearch {
 public:
  /// At the places that the index knows. @param index  outlives this.
  explicit PlaceSearch(const MapIndex& index);
  /// At others. @param places  at least one.
  PlaceSearch(const MapIndex& index, Places places);
  PlaceSearch(const PlaceSearch&) = delete;
  PlaceSearch& operator=(const PlaceSearch&) = delete;

  /// Where to look: everywhere unless said otherwise.
  struct Region {
    /// In the map frame [m]; places farther from it on the ground than the radius are left out.
    Eigen::Vector2d centre_m = Eigen::Vector2d::Zero();
    double radius_m = std::numeric_limits<double>::infinity();
    /// Heading of the levelled lidar's x axis in the map, and how far from it is looked [rad].
    double yaw_rad = 0.0;
    double yaw_window_rad = std::numbers::pi;
  };

  /// Attitude of the scans that are looked for, in a level frame: the lidar as it was mounted when
  /// the map was made. The identity unless it was tilted.
  [[nodiscard]] const Eigen::Matrix3d& R_level_lidar() const { return R_level_lidar_; }

  /// Best places first, the same place only once; empty when nothing stands in the scan, or nobody
  /// has been in the region.
  [[nodiscard]] std::vector<Eigen::Isometry3d> best_places(const Query& query, std::size_t count,
                                                           const Region& region) const;

 private:
  /// A pose by its place, its heading about the place's upward axis, and its offset on that plane.
  struct Hypothesis {
    std::size_t place = 0;
    float yaw_rad = 0.0F;
    float x_m = 0.0F;
    float y_m = 0.0F;
    float score = 0.0F;
  };
  /// Steps around a hypothesis: so many to each side, so wide.
  struct Steps {
    int shifts = 0;
    float shift_m = 0.0F;
    int turns = 0;
    float turn_rad = 0.0F;
  };
  [[nodiscard]] std::vector<Hypothesis> all_in(const Region& region,
                                               const std::vector<Eigen::Vector3f>& points) const;
  /// The best of the steps around each hypothesis. @param grid  of `kPlaceGrids`.
  void improve(std::vector<Hypothesis>& hypotheses, const std::vector<Eigen::Vector3f>& points,
               std::size_t grid, const Steps& steps) const;
  /// A place relative to its window's origin: x and y along the ground.
  [[nodiscard]] Eigen::Isometry3f T_window_place(std::size_t place,
                                                 const IndexWindow& window) const;
  /// Of the levelled lidar.
  [[nodiscard]] Eigen::Isometry3d T_map_level(const Hypothesis& hypothesis) const;

  const MapIndex& index_;
  /// Of those that were given; else the index has them.
  std::vector<PlaceRow> own_places_;
  std::span<const PlaceRow> places_;
  Eigen::Matrix3d R_level_lidar_;
};

}  // namespace stillmap::localization
