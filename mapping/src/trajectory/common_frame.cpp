#include "trajectory/common_frame.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>

#include <optional>
#include <string>

namespace stillmap::mapping {
namespace {

std::string text_of(const std::optional<maps::GeodeticOrigin>& origin) {
  if (!origin) return "poses without a geodetic origin";
  return fmt::format("poses from {:.9f}, {:.9f}, {:.3f} m on", origin->latitude_deg,
                     origin->longitude_deg, origin->altitude_m);
}

bool same(const maps::GeodeticOrigin& a, const maps::GeodeticOrigin& b) {
  return a.latitude_deg == b.latitude_deg && a.longitude_deg == b.longitude_deg &&
         a.altitude_m == b.altitude_m;
}

}  // namespace

Eigen::Isometry3d T_first_own(const maps::Drive& first, const maps::Drive& drive) {
  const auto& origin = first.contents().origin;
  const auto& own = drive.contents().origin;
  if (own.has_value() != origin.has_value())
    throw maps::InputError(
        drive.contents().root.string(), text_of(own),
        text_of(origin) +
            " as the first drive's: give drives in one frame, or build a map of each");
  if (!own || same(*own, *origin)) return Eigen::Isometry3d::Identity();
  return maps::T_enu_enu(*origin, *own);
}

}  // namespace stillmap::mapping
