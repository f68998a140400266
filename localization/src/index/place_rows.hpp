#pragma once

#include "index/index_bytes.hpp"
#include "index/index_window.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <memory>
#include <vector>

namespace stillmap::localization {

/// Where a scan may be looked for, and how it was mounted.
struct Places {
  /// By region, x first; in a region in the order in which they were passed, 3 m apart.
  std::vector<PlaceRow> rows;
  /// Attitude of the scans in a level frame: the lidar as it was mounted. The identity unless it
  /// was tilted.
  Eigen::Matrix3d R_level_lidar = Eigen::Matrix3d::Identity();
};

/// @param T_map_lidar  where the map was seen from, finite. @param origin  of the index.
/// @param bounds  in the map frame [m]: who was far outside saw nothing of it.
[[nodiscard]] Places places_of(const std::vector<Eigen::Isometry3d>& T_map_lidar,
                               const Eigen::Vector3d& origin, const Eigen::AlignedBox3d& bounds);

/// A place relative to its window's origin: x and y along the ground.
[[nodiscard]] Eigen::Isometry3f T_window_place(const PlaceRow& place, const IndexWindow& window,
                                               const Eigen::Vector3d& origin);

/// What stands around each place. @param index  that has the places' regions.
[[nodiscard]] std::vector<PlaceView> views_of(const std::vector<PlaceRow>& places,
                                              const MapIndex& index);

/// The windows of places that come region by region.
class WindowOfPlace {
 public:
  explicit WindowOfPlace(const MapIndex& index) : index_(index) {}
  [[nodiscard]] const IndexWindow& of(maps::RegionId region);

 private:
  const MapIndex& index_;
  maps::RegionId region_;
  std::shared_ptr<const IndexWindow> window_;
};

}  // namespace stillmap::localization
