#pragma once

#include "detection/voxelnext/feature_rows.hpp"
#include "detection/voxelnext/weights.hpp"

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// Which input cells a strided convolution dilates: "spatial voxel pruning" (VoxelNeXt, Fig. 5;
/// from Liu, Chen, Ye, Tian, Tan, Qi, "Spatial Pruned Sparse Convolution for Efficient 3D Object
/// Detection", NeurIPS 2022). Most cells show ground and walls; their features are small, and the
/// cells that a convolution would add around them say nothing.
///
/// The floor(share * rows) rows with the smallest mean of |feature| do not dilate; of equal means
/// those of higher number. Departure: the published layer also multiplies each feature by
/// sigmoid(mean of |feature|), through which a training may learn what to prune. Here features stay
/// as they are, so that pruning changes which cells there are and nothing else.
/// @param share  in [0, 1). @throws std::invalid_argument.
/// @return for each row 1 where it dilates, else 0; the same on any number of threads.
[[nodiscard]] std::vector<std::uint8_t> find_dilating(const FeatureRows& rows, double share);

/// @throws std::invalid_argument for shares outside [0, 1).
void check_pruning(const VoxelNextPruning& pruning);

}  // namespace stillmap::mapping
