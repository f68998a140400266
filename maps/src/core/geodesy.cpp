#include <fmt/format.h>
#include <stillmap/maps/geodesy.hpp>

#include <GeographicLib/Constants.hpp>
#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/LocalCartesian.hpp>
#include <GeographicLib/MGRS.hpp>
#include <GeographicLib/TransverseMercator.hpp>
#include <GeographicLib/UTMUPS.hpp>

#include <cmath>
#include <stdexcept>
#include <vector>

namespace stillmap::maps {
namespace {

constexpr double kFalseEastingM = 500'000.0;
constexpr double kFalseNorthingM = 10'000'000.0;

double central_meridian_deg(UtmZone zone) { return 6.0 * zone.number - 183.0; }

GeographicLib::TransverseMercator mercator_of(double scale) {
  return {GeographicLib::Constants::WGS84_a(), GeographicLib::Constants::WGS84_f(), scale};
}

double false_northing_m(UtmZone zone) { return zone.north ? 0.0 : kFalseNorthingM; }

}  // namespace

Eigen::Isometry3d T_enu_enu(const GeodeticOrigin& a, const GeodeticOrigin& b) {
  const GeographicLib::LocalCartesian local(a.latitude_deg, a.longitude_deg, a.altitude_m);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  std::vector<double> m(9);
  local.Forward(b.latitude_deg, b.longitude_deg, b.altitude_m, T.translation().x(),
                T.translation().y(), T.translation().z(), m);
  T.linear() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(m.data());
  return T;
}

Eigen::Isometry3d T_ecef_enu(const GeodeticOrigin& origin) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  std::vector<double> m(9);
  GeographicLib::Geocentric::WGS84().Forward(origin.latitude_deg, origin.longitude_deg,
                                             origin.altitude_m, T.translation().x(),
                                             T.translation().y(), T.translation().z(), m);
  T.linear() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(m.data());
  return T;
}

GeodeticOrigin place_in_enu(const Eigen::Vector3d& p_enu, const GeodeticOrigin& origin) {
  const GeographicLib::LocalCartesian local(origin.latitude_deg, origin.longitude_deg,
                                            origin.altitude_m);
  GeodeticOrigin place;
  local.Reverse(p_enu.x(), p_enu.y(), p_enu.z(), place.latitude_deg, place.longitude_deg,
                place.altitude_m);
  return place;
}

std::vector<std::string> violations(const GeodeticOrigin& origin) {
  std::vector<std::string> broken;
  const auto check = [&](const char* name, double value, double least, double most) {
    if (!(value >= least && value <= most))
      broken.push_back(fmt::format("{}: {}, expected in [{}, {}]", name, value, least, most));
  };
  check("latitude_deg", origin.latitude_deg, -90.0, 90.0);
  check("longitude_deg", origin.longitude_deg, -180.0, 180.0);
  check("altitude_m", origin.altitude_m, -12'000.0, 100'000.0);
  return broken;
}

std::optional<UtmZone> utm_zone_of(const GeodeticOrigin& place) {
  const int zone = GeographicLib::UTMUPS::StandardZone(place.latitude_deg, place.longitude_deg);
  if (zone < GeographicLib::UTMUPS::MINUTMZONE) return std::nullopt;
  return UtmZone{zone, place.latitude_deg >= 0.0};
}

std::optional<UtmZone> utm_zone_of_epsg(int epsg) {
  const int number = epsg % 100;
  const auto within = [&](int least, int most) { return number >= least && number <= most; };
  switch (epsg / 100) {
    case 326:
      return within(1, 60) ? std::optional<UtmZone>({number, true}) : std::nullopt;
    case 327:
      return within(1, 60) ? std::optional<UtmZone>({number, false}) : std::nullopt;
    case 258:
      return within(28, 38) ? std::optional<UtmZone>({number, true}) : std::nullopt;
    case 269:
      return within(1, 23) ? std::optional<UtmZone>({number, true}) : std::nullopt;
    default:
      return std::nullopt;
  }
}

MercatorGrid grid_of(UtmZone zone) {
  return {central_meridian_deg(zone), GeographicLib::Constants::UTM_k0(),
          Eigen::Vector3d(kFalseEastingM, false_northing_m(zone), 0.0)};
}

MercatorGrid grid_at(const GeodeticOrigin& zero, double scale) {
  Eigen::Vector3d p(0.0, 0.0, zero.altitude_m);
  mercator_of(scale).Forward(zero.longitude_deg, zero.latitude_deg, zero.longitude_deg, p.x(),
                             p.y());
  return {zero.longitude_deg, scale, -p};
}

struct GridProjection::Local {
  GeographicLib::LocalCartesian cartesian;
  GeographicLib::TransverseMercator mercator;
  MercatorGrid grid;
};

GridProjection::GridProjection(const GeodeticOrigin& origin, const MercatorGrid& grid)
    : local_(std::make_unique<Local>(
          Local{GeographicLib::LocalCartesian(origin.latitude_deg, origin.longitude_deg,
                                              origin.altitude_m),
                mercator_of(grid.scale), grid})) {}
GridProjection::~GridProjection() = default;
GridProjection::GridProjection(GridProjection&&) noexcept = default;
GridProjection& GridProjection::operator=(GridProjection&&) noexcept = default;

Eigen::Vector3d GridProjection::to_grid(const Eigen::Vector3d& p_map) const {
  double latitude_deg = 0.0, longitude_deg = 0.0;
  Eigen::Vector3d p_grid;
  local_->cartesian.Reverse(p_map.x(), p_map.y(), p_map.z(), latitude_deg, longitude_deg,
                            p_grid.z());
  local_->mercator.Forward(local_->grid.central_meridian_deg, latitude_deg, longitude_deg,
                           p_grid.x(), p_grid.y());
  return p_grid + local_->grid.offset;
}

Eigen::Vector3d GridProjection::to_map(const Eigen::Vector3d& p_grid) const {
  double latitude_deg = 0.0, longitude_deg = 0.0;
  const Eigen::Vector3d p = p_grid - local_->grid.offset;
  local_->mercator.Reverse(local_->grid.central_meridian_deg, p.x(), p.y(), latitude_deg,
                           longitude_deg);
  Eigen::Vector3d p_map;
  local_->cartesian.Forward(latitude_deg, longitude_deg, p.z(), p_map.x(), p_map.y(), p_map.z());
  return p_map;
}

GeodeticOrigin place_in_grid(const Eigen::Vector3d& p_grid, const MercatorGrid& grid) {
  const Eigen::Vector3d p = p_grid - grid.offset;
  // A zone and its neighbours; beyond, the projection folds up.
  if (!(std::abs(p.x()) <= 1e6 && std::abs(p.y()) <= 1.1e7))
    throw std::invalid_argument(
        fmt::format("easting {}, northing {}: not of this grid", p_grid.x(), p_grid.y()));
  GeodeticOrigin place;
  mercator_of(grid.scale)
      .Reverse(grid.central_meridian_deg, p.x(), p.y(), place.latitude_deg, place.longitude_deg);
  place.altitude_m = p.z();
  return place;
}

MgrsSquare mgrs_square(const std::string& name) {
  MgrsSquare square;
  int precision = 0;
  try {
    GeographicLib::MGRS::Reverse(name, square.zone.number, square.zone.north, square.corner.x(),
                                 square.corner.y(), precision, false);
  } catch (const GeographicLib::GeographicErr& error) {
    throw std::invalid_argument(error.what());
  }
  if (precision != 0 || square.zone.number < GeographicLib::UTMUPS::MINUTMZONE)
    throw std::invalid_argument(name + " is no square of 100 km in a zone of UTM");
  return square;
}

std::string mgrs_name(const Eigen::Vector3d& p_utm, UtmZone zone) {
  std::string name;
  try {
    GeographicLib::MGRS::Forward(zone.number, zone.north, p_utm.x(), p_utm.y(), 0, name);
  } catch (const GeographicLib::GeographicErr& error) {
    throw std::invalid_argument(error.what());
  }
  return name;
}

GeodeticOrigin geodetic_of(const Eigen::Vector3d& p_utm, UtmZone zone) {
  // A zone and its neighbours; beyond, the projection folds up.
  if (!(std::abs(p_utm.x() - kFalseEastingM) <= 1e6 && p_utm.y() >= -1e6 && p_utm.y() <= 1.1e7))
    throw std::invalid_argument(fmt::format("easting {}, northing {}: not of UTM zone {}{}",
                                            p_utm.x(), p_utm.y(), zone.number,
                                            zone.north ? "N" : "S"));
  return place_in_grid(p_utm, grid_of(zone));
}

}  // namespace stillmap::maps
