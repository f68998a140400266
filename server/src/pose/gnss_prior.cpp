#include "pose/gnss_prior.hpp"

#include <stillmap/maps/geodesy.hpp>

#include <algorithm>
#include <numbers>

namespace stillmap::server {
namespace {

/// Heights of satellite receivers are worse than their places by about this factor (geometry: all
/// satellites are above).
constexpr double kVerticalFactor = 1.5;
/// How far streets and loads tilt a vehicle [rad].
constexpr double kTiltRad = 0.2;

}  // namespace

localization::Prior prior_from(const GnssFix& fix, const maps::GeodeticOrigin& origin,
                               std::span<const Eigen::Isometry3d> T_map_seen) {
  const maps::GeodeticOrigin place{.latitude_deg = fix.latitude_deg,
                                   .longitude_deg = fix.longitude_deg,
                                   .altitude_m = fix.altitude_m.value_or(origin.altitude_m)};
  const Eigen::Vector3d p_map = maps::T_enu_enu(origin, place).translation();
  const auto distance = [&](const Eigen::Isometry3d& T) {
    return (T.translation() - p_map).head<2>().squaredNorm();
  };
  const auto nearest =
      std::min_element(T_map_seen.begin(), T_map_seen.end(),
                       [&](const auto& a, const auto& b) { return distance(a) < distance(b); });
  localization::Prior prior;
  if (nearest != T_map_seen.end()) prior.T_map_lidar = *nearest;
  prior.T_map_lidar.translation().head<2>() = p_map.head<2>();
  if (fix.altitude_m || nearest == T_map_seen.end())
    prior.T_map_lidar.translation().z() = p_map.z();
  const double vertical_m = (fix.altitude_m ? kVerticalFactor : 1.0) * fix.sigma_m;
  Eigen::Matrix<double, 6, 1> sigma;
  sigma << fix.sigma_m, fix.sigma_m, vertical_m, kTiltRad, kTiltRad, std::numbers::pi;
  // Told in the map's axes, of which z is upward; the covariance is in the lidar's.
  const Eigen::Matrix3d R_lidar_map = prior.T_map_lidar.linear().transpose();
  prior.covariance.emplace().setZero();
  for (const int block : {0, 3})
    prior.covariance->block<3, 3>(block, block) =
        R_lidar_map * sigma.segment<3>(block).cwiseAbs2().asDiagonal() * R_lidar_map.transpose();
  return prior;
}

}  // namespace stillmap::server
