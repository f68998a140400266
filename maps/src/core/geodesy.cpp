#include <fmt/format.h>
#include <stillmap/maps/geodesy.hpp>

#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/LocalCartesian.hpp>
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

struct UtmProjection::Local {
  GeographicLib::LocalCartesian cartesian;
};

UtmProjection::UtmProjection(const GeodeticOrigin& origin, UtmZone zone)
    : local_(std::make_unique<Local>(Local{GeographicLib::LocalCartesian(
          origin.latitude_deg, origin.longitude_deg, origin.altitude_m)})),
      zone_(zone) {}
UtmProjection::~UtmProjection() = default;
UtmProjection::UtmProjection(UtmProjection&&) noexcept = default;
UtmProjection& UtmProjection::operator=(UtmProjection&&) noexcept = default;

Eigen::Vector3d UtmProjection::to_utm(const Eigen::Vector3d& p_map) const {
  double latitude_deg = 0.0, longitude_deg = 0.0;
  Eigen::Vector3d p_utm;
  local_->cartesian.Reverse(p_map.x(), p_map.y(), p_map.z(), latitude_deg, longitude_deg,
                            p_utm.z());
  GeographicLib::TransverseMercator::UTM().Forward(central_meridian_deg(zone_), latitude_deg,
                                                   longitude_deg, p_utm.x(), p_utm.y());
  return p_utm + Eigen::Vector3d(kFalseEastingM, false_northing_m(zone_), 0.0);
}

Eigen::Vector3d UtmProjection::to_map(const Eigen::Vector3d& p_utm) const {
  double latitude_deg = 0.0, longitude_deg = 0.0;
  GeographicLib::TransverseMercator::UTM().Reverse(
      central_meridian_deg(zone_), p_utm.x() - kFalseEastingM, p_utm.y() - false_northing_m(zone_),
      latitude_deg, longitude_deg);
  Eigen::Vector3d p_map;
  local_->cartesian.Forward(latitude_deg, longitude_deg, p_utm.z(), p_map.x(), p_map.y(),
                            p_map.z());
  return p_map;
}

GeodeticOrigin geodetic_of(const Eigen::Vector3d& p_utm, UtmZone zone) {
  // A zone and its neighbours; beyond, the projection folds up.
  if (!(std::abs(p_utm.x() - kFalseEastingM) <= 1e6 && p_utm.y() >= -1e6 && p_utm.y() <= 1.1e7))
    throw std::invalid_argument(fmt::format("easting {}, northing {}: not of UTM zone {}{}",
                                            p_utm.x(), p_utm.y(), zone.number,
                                            zone.north ? "N" : "S"));
  GeodeticOrigin place;
  GeographicLib::TransverseMercator::UTM().Reverse(
      central_meridian_deg(zone), p_utm.x() - kFalseEastingM, p_utm.y() - false_northing_m(zone),
      place.latitude_deg, place.longitude_deg);
  place.altitude_m = p_utm.z();
  return place;
}

}  // namespace stillmap::maps
