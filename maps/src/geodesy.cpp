#include <stillmap/maps/geodesy.hpp>

#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/LocalCartesian.hpp>

#include <vector>

namespace stillmap::maps {

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

}  // namespace stillmap::maps
