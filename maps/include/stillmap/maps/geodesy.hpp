#pragma once

#include <stillmap/maps/drive.hpp>

#include <Eigen/Geometry>

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::maps {

/// East-north-up frame at `b`, seen from that at `a`: takes points [m] from the second to the first
/// (WGS 84, straight lines through the Earth, GeographicLib's LocalCartesian).
[[nodiscard]] Eigen::Isometry3d T_enu_enu(const GeodeticOrigin& a, const GeodeticOrigin& b);

/// The same frame seen from the Earth's centre (ECEF: x to 0 N 0 E, z to the North Pole).
[[nodiscard]] Eigen::Isometry3d T_ecef_enu(const GeodeticOrigin& origin);

/// Place of a point [m] of the east-north-up frame at `origin` (the inverse of `T_enu_enu`'s
/// translation); longitude in [-180, 180], 0 on the Earth's axis.
[[nodiscard]] GeodeticOrigin place_in_enu(const Eigen::Vector3d& p_enu,
                                          const GeodeticOrigin& origin);

/// Every bound that a place breaks, as "name: value, bound"; empty for one on Earth: latitude in
/// [-90, 90], longitude in [-180, 180], altitude in [-12000, 100000] m.
[[nodiscard]] std::vector<std::string> violations(const GeodeticOrigin& origin);

/// A zone of the Universal Transverse Mercator projection of WGS 84.
struct UtmZone {
  /// In [1, 60].
  int number = 1;
  bool north = true;

  /// 326NN or 327NN.
  [[nodiscard]] int epsg() const { return (north ? 32600 : 32700) + number; }
  bool operator==(const UtmZone&) const = default;
};

/// Zone that a place lies in, with the exceptions of Norway and Svalbard.
/// @return nothing in the polar regions (beyond 84 deg north or 80 deg south), which UTM leaves
/// out.
[[nodiscard]] std::optional<UtmZone> utm_zone_of(const GeodeticOrigin& place);

/// Zone that an EPSG code names: WGS 84 (326NN, 327NN), and ETRS 89 (258NN) and NAD 83 (269NN),
/// which are taken as WGS 84: their zones are the same to a metre or two. Nothing for another code.
[[nodiscard]] std::optional<UtmZone> utm_zone_of_epsg(int epsg);

/// Coordinates by the transverse Mercator projection of WGS 84, such as UTM.
struct MercatorGrid {
  double central_meridian_deg = 0.0;
  /// On the central meridian.
  double scale = 0.9996;
  /// Added to easting and northing from the central meridian and the equator, and to the height
  /// above the ellipsoid [m].
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
};
/// Easting, northing and height of a zone of UTM.
[[nodiscard]] MercatorGrid grid_of(UtmZone zone);
/// Of this scale, with its central meridian and its zero at a place.
[[nodiscard]] MercatorGrid grid_at(const GeodeticOrigin& zero, double scale);

/// Between a local frame (east-north-up, straight lines through the Earth) and a grid.
///
/// Exact to nanometres within a zone's width; a map is not only moved and turned by it: lengths
/// change by the grid's scale (UTM: 0.9996 to 1.001), and the height of a plane by the curvature of
/// the Earth (8 cm in 1 km).
class GridProjection {
 public:
  GridProjection(const GeodeticOrigin& origin, const MercatorGrid& grid);
  ~GridProjection();
  GridProjection(GridProjection&&) noexcept;
  GridProjection& operator=(GridProjection&&) noexcept;

  [[nodiscard]] Eigen::Vector3d to_grid(const Eigen::Vector3d& p_map) const;
  [[nodiscard]] Eigen::Vector3d to_map(const Eigen::Vector3d& p_grid) const;

 private:
  struct Local;
  std::unique_ptr<const Local> local_;
};

/// The same for a zone of UTM: easting, northing and height above the ellipsoid [m].
class UtmProjection {
 public:
  UtmProjection(const GeodeticOrigin& origin, UtmZone zone)
      : projection_(origin, grid_of(zone)), zone_(zone) {}

  [[nodiscard]] UtmZone zone() const { return zone_; }
  [[nodiscard]] Eigen::Vector3d to_utm(const Eigen::Vector3d& p_map) const {
    return projection_.to_grid(p_map);
  }
  [[nodiscard]] Eigen::Vector3d to_map(const Eigen::Vector3d& p_utm) const {
    return projection_.to_map(p_utm);
  }

 private:
  GridProjection projection_;
  UtmZone zone_;
};

/// Place of easting, northing and height above the ellipsoid [m].
/// @throws std::invalid_argument for coordinates that are not of this zone.
[[nodiscard]] GeodeticOrigin geodetic_of(const Eigen::Vector3d& p_utm, UtmZone zone);
/// The same of a grid. @throws std::invalid_argument for coordinates over 1,000 km from its central
/// meridian or beyond a pole.
[[nodiscard]] GeodeticOrigin place_in_grid(const Eigen::Vector3d& p_grid, const MercatorGrid& grid);

/// A square of 100 km of the Military Grid Reference System.
struct MgrsSquare {
  UtmZone zone;
  /// Of its south-west corner in the zone [m].
  Eigen::Vector2d corner = Eigen::Vector2d::Zero();
};
/// The square that a name such as `54SUE` stands for. @throws std::invalid_argument for another
/// text, and for squares of the polar regions.
[[nodiscard]] MgrsSquare mgrs_square(const std::string& name);
/// The name of the square around a place in a zone of UTM. @throws std::invalid_argument where
/// there is none.
[[nodiscard]] std::string mgrs_name(const Eigen::Vector3d& p_utm, UtmZone zone);

}  // namespace stillmap::maps
