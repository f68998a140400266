#pragma once

#include <stillmap/maps/map_package.hpp>

#include "json/json_values.hpp"

namespace stillmap::server {

/// How a version was brought into the frame of the one before, as in its manifest.
[[nodiscard]] inline Json to_json(const maps::Registration& registration) {
  Json json;
  json["previous_digest"] = registration.previous_digest;
  json["T_previous_map"] = to_json_pose(registration.T_previous_map);
  json["T_map_poses"] = to_json_pose(registration.T_map_poses);
  json["residual_m"] = registration.residual_m;
  json["residual_rad"] = registration.residual_rad;
  json["scans_used"] = registration.scans_used;
  json["scans_asked"] = registration.scans_asked;
  return json;
}

}  // namespace stillmap::server
