#pragma once

#include <stillmap/maps/box.hpp>

#include <vector>

namespace stillmap::mapping {

/// Goes through boxes from the highest score to the lowest (equal scores: in the order given) and
/// keeps each whose IoU seen from above (`overlap_of`) with every box kept before it is at most
/// `most_iou`, whatever the
/// classes. Time grows with the number of boxes and of kept ones near each.
/// @param boxes  of finite size.
[[nodiscard]] std::vector<maps::Box> suppress_overlaps(std::vector<maps::Box> boxes,
                                                       double most_iou);

}  // namespace stillmap::mapping
