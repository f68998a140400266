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

/// Between a local frame (east-north-up, straight lines through the Earth) and a zone of UTM.
///
/// Easting, northing and height above the ellipsoid [m]. Exact to nanometres within the zone; a map
/// is not only moved and turned by it: lengths change by the zone's scale (0.9996 to 1.001), and
/// the height of a plane by the curvature of the Earth (8 cm in 1 km).
class UtmProjection {
 public:
  UtmProjection(const GeodeticOrigin& origin, UtmZone zone);
  ~UtmProjection();
  UtmProjection(UtmProjection&&) noexcept;
  UtmProjection& operator=(UtmProjection&&) noexcept;

  [[nodiscard]] UtmZone zone() const { return zone_; }
  [[nodiscard]] Eigen::Vector3d to_utm(const Eigen::Vector3d& p_map) const;
  [[nodiscard]] Eigen::Vector3d to_map(const Eigen::Vector3d& p_utm) const;

 private:
  struct Local;
  std::unique_ptr<const Local> local_;
  UtmZone zone_;
};

/// Place of easting, northing and height above the ellipsoid [m].
/// @throws std::invalid_argument for coordinates that are not of this zone.
[[nodiscard]] GeodeticOrigin geodetic_of(const Eigen::Vector3d& p_utm, UtmZone zone);

}  // namespace stillmap::maps
