#pragma once

#include "ground/fused_ground.hpp"
#include "ground/ground_footprint.hpp"

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <span>
#include <vector>

namespace stillmap::mapping {

/// Makes the ground that nothing was measured of and nothing was projected to, under objects that
/// were removed: the far half of a car that was passed on one side.
///
/// One point stands at the middle of each column of voxels in a footprint, at the height of the
/// fused ground, unless
///  - that column, or one of the four beside it, holds a ground or projected point within 5 cm of
///    that height, or
///  - the ground's confidence there is below 0.05: at most some 8 m from ground that was measured,
///  less
///    where that was seen rarely or from afar.
/// @param tile        of level 0; only columns whose middle lies in it are filled, so that tiles
/// can
///                    be filled one by one, in any order.
/// @param points      of that tile, of all kinds.
/// @param footprints  of removed objects, local frame; those elsewhere are passed over.
/// @param ground      finished.
/// @param voxel_m     edge of a voxel, > 0.
/// @return local frame, row by row. Same input, same bits.
/// @throws std::invalid_argument for a tile of another level, or a voxel that is not above zero.
/// @note   Pure, so safe from several threads. Along a tile's border the neighbour's points are not
///         seen: a filled point may stand beside one of them.
[[nodiscard]] std::vector<Eigen::Vector3d> fill_ground(maps::TileId tile,
                                                       const maps::MapTile& points,
                                                       std::span<const GroundFootprint> footprints,
                                                       const FusedGround& ground, double voxel_m);

}  // namespace stillmap::mapping
