#pragma once

#include "index/index_window.hpp"
#include "index/place_rows.hpp"
#include "query.hpp"

#include <Eigen/Geometry>

#include <cstddef>
#include <limits>
#include <numbers>
#include <span>
#include <tuple>
#include <vector>

namespace stillmap::localization {

/// Where in a map a scan may have been taken, from all places that the map was seen from.
///
/// In three rounds. The first compares what the scan shows around itself with the `PlaceView` of
/// every place, in every heading. At the best 900 it counts how many of the scan's standing points
/// fall into occupied cells of the map, as `search_poses` does: on cells of 2 m,
/// then the best of those on 1 m cells. So only the first round grows with the map, by a
/// microsecond a place ([decision](../../decisions/views_of_places.md)).
class PlaceSearch {
 public:
  /// At the places that the index knows. @param index  outlives this.
  explicit PlaceSearch(const MapIndex& index);
  /// At others, whose views are made here. @param places  at least one.
  /// @throws maps::InputError, maps::StorageError as `MapIndex::around`.
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

    /// Ties are broken, so that no result depends on a sort.
    [[nodiscard]] bool is_better_than(const Hypothesis& other) const {
      if (score != other.score) return score > other.score;
      return std::tie(place, yaw_rad) < std::tie(other.place, other.yaw_rad);
    }
  };
  static void keep_best(std::vector<Hypothesis>& all, std::size_t count);
  /// Steps around a hypothesis: so many to each side, so wide.
  struct Steps {
    int shifts = 0;
    float shift_m = 0.0F;
    int turns = 0;
    float turn_rad = 0.0F;
  };
  /// Of all places of a region, the best by their views; by hits when a scan shows nothing above
  /// the lidar. @param points  some of those that stand.
  [[nodiscard]] std::vector<Hypothesis> best_views(
      const Query& query, const Region& region, const std::vector<Eigen::Vector3f>& points) const;
  /// The best of the steps around each hypothesis. @param grid  of `kPlaceGridEdgesM`.
  void improve(std::vector<Hypothesis>& hypotheses, const std::vector<Eigen::Vector3f>& points,
               std::size_t grid, const Steps& steps) const;
  /// Of the levelled lidar.
  [[nodiscard]] Eigen::Isometry3d T_map_level(const Hypothesis& hypothesis) const;

  const MapIndex& index_;
  /// Of those that were given; else the index has them.
  std::vector<PlaceRow> own_places_;
  std::vector<PlaceView> own_views_;
  std::span<const PlaceRow> places_;
  std::span<const PlaceView> views_;
  Eigen::Matrix3d R_level_lidar_;
};

}  // namespace stillmap::localization
