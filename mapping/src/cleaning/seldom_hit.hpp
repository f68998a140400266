#pragma once

#include "cleaning/free_evidence.hpp"

#include <stillmap/mapping/cleaning.hpp>

#include <Eigen/Geometry>

#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Finds what moved before a fixed sensor: cells that few of its scans hit, and none near them that
/// more do.
///
/// All scans look the same ways from the same place, so what stays is hit again and again, and what
/// passes is hit by a scan or two, also where there is nothing behind it that a view could see it
/// free against. A cell goes when no cell within 0.2 m of height and 0.2 m + 0.5 % of the
/// range of way was hit by 4 % of the scans; ground too,
/// since single scans take parts of vehicles for ground.
/// @param area  flags of points outside of it, less that reach, mean nothing.
/// @return a flag a point, 1 = goes; none unless all keyframes are of one place and there are 200
/// scans or more (20 s).
[[nodiscard]] std::vector<std::uint8_t> seldom_hit(const CleaningPoints& points,
                                                   const Eigen::AlignedBox2f& area,
                                                   const PosedViews& views,
                                                   std::span<const Keyframe> keyframes);

}  // namespace stillmap::mapping
