#pragma once

#include "reference/block_grid.hpp"
#include "reference/scan_space.hpp"

#include <cstddef>

/// The steps of DUFOMap within one scan; see dufomap.hpp.
namespace stillmap::mapping::reference {

/// Marks voxels as free from the sensor to each ray's end or the first hit voxel, whichever comes
/// first, that one included, and beyond it until some axis has gone `beyond` voxels.
/// After `mark_hits` of the same rays.
void mark_free(const ScanRays& rays, int beyond, ScanSpace& space);

/// The voxels of a block that are free, not hit, and have only free or hit voxels within
/// `unknown_voxels`, in [0, 7], on each axis.
[[nodiscard]] BlockBits void_region(const ScanSpace& space, std::size_t block, int unknown_voxels);

}  // namespace stillmap::mapping::reference
