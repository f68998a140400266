#pragma once

#include <stillmap/maps/geodesy.hpp>

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace stillmap::maps {

/// What a file says of its coordinates.
struct CoordinateSystem {
  /// As the file names it; empty when it does not.
  std::string name;
  /// Of easting and northing, or of all three axes; nothing when unknown.
  std::optional<double> metres_per_unit;
  /// Longitude and latitude.
  bool is_geographic = false;
  /// Heights have a datum of their own, rather than being above the ellipsoid.
  std::string vertical_name;
  /// Of heights, where they have a datum of their own; nothing when unknown.
  std::optional<double> vertical_metres_per_unit;
  /// Of WGS 84, or of a datum that is taken as it.
  std::optional<UtmZone> utm;
};

/// Reads WKT 1 and 2 as far as this, and no more: what is not understood is left unknown. Never
/// fails, whatever the bytes.
[[nodiscard]] CoordinateSystem read_wkt(std::string_view text);

/// Reads the directory of GeoTIFF keys (16-bit little endian) in the same way.
[[nodiscard]] CoordinateSystem read_geo_keys(std::span<const std::byte> bytes);

}  // namespace stillmap::maps
