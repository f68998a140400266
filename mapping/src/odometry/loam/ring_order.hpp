#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping::loam {

/// Where each ring starts, then N, if points are listed ring by ring; empty where they are not.
///
/// The azimuth then goes on forward, a turn a ring. All rings start at about one azimuth (KITTI:
/// straight ahead), found as that where the elevation jumps to one and the same side in most turns;
/// within some degrees of it each ring starts at the largest jump, since lasers have azimuths of
/// their own. At the edge of things the elevation jumps too, because lasers sit above each other,
/// but to either side.
/// @param azimuths, elevations  N values [rad].
[[nodiscard]] std::vector<std::uint32_t> ring_starts_by_order(std::span<const float> azimuths,
                                                              std::span<const float> elevations);

}  // namespace stillmap::mapping::loam
