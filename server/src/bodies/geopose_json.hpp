#pragma once

#include "pose/pose_answer.hpp"

#include <stillmap/maps/drive.hpp>

#include <string>

/// Poses on the Earth as OGC GeoPose 1.0 (OGC 21-056r11) writes them in JSON.
namespace stillmap::server {

/// What the standard calls a standardization target.
enum class GeoPoseTarget { kBasicQuaternion, kAdvanced };

/// The answer's pose as GeoPose: of the base when its mount is known, else of the lidar.
///
/// The place is WGS 84 with the height above the ellipsoid [m]; the rotation takes the vehicle's
/// axes to east, north and up at the vehicle itself, not at the map's origin. Advanced has the
/// scan's stamp, if there is one, as `validTime` [ms].
/// @param answer  not lost. @param origin  of the map frame.
[[nodiscard]] std::string geopose_json(const PoseAnswer& answer, GeoPoseTarget target,
                                       const maps::GeodeticOrigin& origin);

}  // namespace stillmap::server
