#include "index/place_rows.hpp"

#include "index_grid.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>

namespace stillmap::localization {
namespace {

// Places are looked at this far apart [m].
constexpr double kSpacingM = 3.0;
// Poses farther than this outside the map's bounds saw nothing of it [m].
constexpr double kPlaceMarginM = 100.0;

// Mounts that are tilted by less keep the lidar's z as their upward axis [rad].
constexpr double kTiltedRad = 0.2;

// Length of the mean of the upward axes of one sensor: hills of 10 degrees leave 0.985.
constexpr double kLeastAlike = 0.97;

/// From the mean of the map's upward axis in the lidar: hills even out, mounts do not.
Eigen::Matrix3d levelling(const std::vector<Eigen::Isometry3d>& T_map_lidar) {
  Eigen::Vector3d up_lidar = Eigen::Vector3d::Zero();
  for (const Eigen::Isometry3d& T : T_map_lidar) up_lidar += T.linear().row(2).transpose();
  // Sensors that are mounted in different ways share no frame; each pose has its own then.
  if (up_lidar.norm() < kLeastAlike * static_cast<double>(T_map_lidar.size()))
    return Eigen::Matrix3d::Identity();
  const double tilt_rad = std::atan2(up_lidar.head<2>().norm(), up_lidar.z());
  if (!(tilt_rad > kTiltedRad)) return Eigen::Matrix3d::Identity();
  return maps::turn_between(up_lidar, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

/// Upright frame: z is the levelled pose's own, x as near to the map's x as that allows.
Eigen::Matrix3d without_heading(const Eigen::Matrix3d& R_map_level) {
  const Eigen::Vector3d up = R_map_level.col(2);
  // Along the map's x there is none nearer than another.
  const bool along_x = std::abs(up.x()) > 0.999;
  const Eigen::Vector3d y =
      up.cross(along_x ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitX()).normalized();
  Eigen::Matrix3d R;
  R << y.cross(up), y, up;
  return R;
}

/// Takes places that are `kSpacingM` or more from all those taken, by cells of that size.
class PlacesApart {
 public:
  bool take(const Eigen::Vector3d& p) {
    const Cell cell = cell_at(p);
    for (int around = 0; around < 27; ++around) {
      const auto found = taken_.find(
          {cell[0] + around / 9 - 1, cell[1] + around / 3 % 3 - 1, cell[2] + around % 3 - 1});
      if (found == taken_.end()) continue;
      for (const Eigen::Vector3d& q : found->second) {
        if ((p - q).squaredNorm() < kSpacingM * kSpacingM) return false;
      }
    }
    taken_[cell].push_back(p);
    return true;
  }

 private:
  using Cell = std::array<std::int64_t, 3>;
  static Cell cell_at(const Eigen::Vector3d& p) {
    const auto along = [](double at) {
      return static_cast<std::int64_t>(std::floor(at / kSpacingM));
    };
    return {along(p.x()), along(p.y()), along(p.z())};
  }
  std::map<Cell, std::vector<Eigen::Vector3d>> taken_;
};

PlaceRow row_of(const Eigen::Matrix3d& R_map_place, const Eigen::Vector3d& p) {
  PlaceRow row{.region = region_at(p.x(), p.y()), .R_map_place = {}, .place_m = {}};
  const Eigen::Vector2d corner = corner_of(row.region);
  Eigen::Matrix3f::Map(row.R_map_place.data()) = R_map_place.cast<float>();
  row.place_m = {static_cast<float>(p.x() - corner.x()), static_cast<float>(p.y() - corner.y()),
                 static_cast<float>(p.z())};
  return row;
}

}  // namespace

Places places_of(const std::vector<Eigen::Isometry3d>& T_map_lidar, const Eigen::Vector3d& origin,
                 const Eigen::AlignedBox3d& bounds) {
  Places places;
  places.R_level_lidar = levelling(T_map_lidar);
  PlacesApart apart;
  for (const Eigen::Isometry3d& T : T_map_lidar) {
    if (bounds.squaredExteriorDistance(T.translation()) > kPlaceMarginM * kPlaceMarginM) continue;
    const Eigen::Vector3d p = T.translation() - origin;
    if (!apart.take(p)) continue;
    places.rows.push_back(
        row_of(without_heading(T.linear() * places.R_level_lidar.transpose()), p));
  }
  std::stable_sort(places.rows.begin(), places.rows.end(),
                   [](const PlaceRow& a, const PlaceRow& b) { return a.region < b.region; });
  return places;
}

Eigen::Isometry3f T_window_place(const PlaceRow& place, const IndexWindow& window,
                                 const Eigen::Vector3d& origin) {
  const auto floor_m = static_cast<float>(window.origin().z() - origin.z());
  Eigen::Isometry3f T = Eigen::Isometry3f::Identity();
  T.linear() = Eigen::Matrix3f::Map(place.R_map_place.data());
  T.translation() << place.place_m[0], place.place_m[1], place.place_m[2] - floor_m;
  return T;
}

std::vector<PlaceView> views_of(const std::vector<PlaceRow>& places, const MapIndex& index) {
  std::vector<PlaceView> views;
  views.reserve(places.size());
  WindowOfPlace windows(index);
  for (const PlaceRow& place : places) {
    const IndexWindow& window = windows.of(place.region);
    views.push_back(
        view_of_place(window.place_grids().back(), T_window_place(place, window, index.origin())));
  }
  return views;
}

const IndexWindow& WindowOfPlace::of(maps::RegionId region) {
  if (!window_ || region != region_) window_ = index_.around(region);
  region_ = region;
  return *window_;
}

}  // namespace stillmap::localization
