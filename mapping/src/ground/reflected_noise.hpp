#pragma once

#include "ground/seed_plane.hpp"

#include <stillmap/maps/scan.hpp>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// Reflected noise removal: points of steep downward rays that lie far below the ground and are
/// weak, as wet roads and glass give them.
///
/// Departures: rays steeper than 15 degrees, as in the authors' program, stand for the lowest
/// beams, which a cloud without rings does not tell; below the plane under the sensor instead of
/// below a level, which on a descent would take the street itself; weak is below the scan's median
/// intensity, since sensors differ in scale; without intensities, by geometry alone.
/// @return N flags, 1 = noise, or empty when there is none.
/// @see Patchwork++, IROS 2022, reflected noise removal.
[[nodiscard]] std::vector<std::uint8_t> find_reflected_noise(const maps::PointCloud& cloud,
                                                             const SeedPlane& plane);

}  // namespace stillmap::mapping
