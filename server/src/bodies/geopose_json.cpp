#include "bodies/geopose_json.hpp"

#include "json/json_values.hpp"

#include <stillmap/maps/geodesy.hpp>

#include <fmt/format.h>

#include <cmath>
#include <cstdint>

namespace stillmap::server {
namespace {

Json quaternion_json(const Eigen::Matrix3d& R) {
  Eigen::Quaterniond q(R);
  q.normalize();
  if (q.w() < 0.0) q.coeffs() *= -1.0;
  return {{"x", q.x()}, {"y", q.y()}, {"z", q.z()}, {"w", q.w()}};
}

/// The standard counts Unix time in whole milliseconds.
std::int64_t to_milliseconds(std::int64_t stamp_ns) {
  constexpr std::int64_t kNsPerMs = 1'000'000;
  const std::int64_t rest = stamp_ns % kNsPerMs;
  const std::int64_t carry = rest >= kNsPerMs / 2 ? 1 : rest < -kNsPerMs / 2 ? -1 : 0;
  return stamp_ns / kNsPerMs + carry;
}

}  // namespace

std::string geopose_json(const PoseAnswer& answer, GeoPoseTarget target,
                         const maps::GeodeticOrigin& origin) {
  Eigen::Isometry3d T_map_vehicle = answer.result.T_map_lidar;
  if (const auto& T_base_lidar = answer.parameters.T_base_lidar)
    T_map_vehicle = T_map_vehicle * T_base_lidar->inverse();
  const maps::GeodeticOrigin place = maps::place_in_enu(T_map_vehicle.translation(), origin);
  const Eigen::Matrix3d R_enu_vehicle =
      maps::T_enu_enu(place, origin).linear() * T_map_vehicle.linear();
  Json json;
  if (target == GeoPoseTarget::kBasicQuaternion) {
    json["position"] = {
        {"lat", place.latitude_deg}, {"lon", place.longitude_deg}, {"h", place.altitude_m}};
    json["quaternion"] = quaternion_json(R_enu_vehicle);
    return to_text(json);
  }
  // 1e-10 deg are 0.01 mm.
  json["frameSpecification"] = {
      {"authority", "/geopose/1.0"},
      {"id", "LTP-ENU"},
      {"parameters", fmt::format("longitude={:.10f}&latitude={:.10f}&height={:.5f}",
                                 place.longitude_deg, place.latitude_deg, place.altitude_m)}};
  json["quaternion"] = quaternion_json(R_enu_vehicle);
  if (const auto& stamp_ns = answer.parameters.stamp_ns)
    json["validTime"] = to_milliseconds(*stamp_ns);
  return to_text(json);
}

}  // namespace stillmap::server
