#pragma once

#include <stillmap/maps/box.hpp>

#include <vector>

namespace stillmap::mapping {

/// Intersection over union of two boxes seen from above, in [0, 1].
[[nodiscard]] double bev_iou(const maps::Box& a, const maps::Box& b);

/// Goes through boxes from the highest score to the lowest (equal scores: in the order given) and
/// keeps each whose `bev_iou` with every box kept before it is at most `most_iou`, whatever the
/// classes. Time grows with the number of boxes and of kept ones near each.
/// @param boxes  of finite size.
[[nodiscard]] std::vector<maps::Box> suppress_overlaps(std::vector<maps::Box> boxes,
                                                       double most_iou);

}  // namespace stillmap::mapping
