#pragma once

#include <stillmap/maps/box.hpp>

#include <cstddef>
#include <string>
#include <vector>

#include "output/kitti_camera.hpp"

namespace stillmap::simulation {

/// Lines of KITTI's tracking labels (`label_02/*.txt`) for the boxes of one scan: those whose
/// centre lies ahead of the camera and of which some part is in its image. Truncation and occlusion
/// are levels from 0 (none) to 2 (most of it), from the boxes' outlines alone; buses are written as
/// Truck, trailers, motorcycles and what is unknown as Misc, since KITTI has no type for them.
/// @param boxes  in the lidar frame.
[[nodiscard]] std::string tracking_labels(std::size_t frame, const std::vector<maps::Box>& boxes,
                                          const KittiCamera& camera);

}  // namespace stillmap::simulation
