#pragma once

#include "views/posed_views.hpp"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Finds those of a scan's doubtful points that no neighbouring scan confirms: none of the eight
/// scans before and the eight after it has a return there.
/// @param positions  N points, lidar frame [m].
/// @param doubtful   N flags, or empty = none.
/// @param scan       ordinal of the scan.
/// @param views      of all scans; `read` is called for the neighbours.
/// @return N flags, 1 = doubtful and not confirmed; empty without doubtful points.
[[nodiscard]] std::vector<std::uint8_t> find_unconfirmed_points(
    std::span<const Eigen::Vector3f> positions, const std::vector<bool>& doubtful, std::size_t scan,
    const PosedViews& views);

}  // namespace stillmap::mapping
