#pragma once

#include <stillmap/maps/geodesy.hpp>

#include <string>
#include <string_view>

namespace stillmap::maps {

/// WKT 1 (OGC 01-009) of a zone of UTM on WGS 84.
[[nodiscard]] std::string utm_wkt(UtmZone zone);

/// WKT 1 of a frame that no authority knows. @param enu  whether its axes point east, north and up.
[[nodiscard]] std::string local_wkt(std::string_view frame_id, bool enu);

}  // namespace stillmap::maps
