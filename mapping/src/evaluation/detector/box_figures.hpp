#pragma once

#include "evaluation/detector/box_matching.hpp"

#include <stillmap/mapping/detector_evaluation.hpp>

#include <vector>

namespace stillmap::mapping {

/// All that boxes and labels of scans say, but for `source`, `in_camera_only` and
/// `false_boxes_hold`.
/// @param scans  one or more.
[[nodiscard]] BoxDetection box_figures(const std::vector<ScanBoxes>& scans, double max_range_m);

/// Truth that counts within `max_range_m`.
[[nodiscard]] Window whole_window(double max_range_m);

}  // namespace stillmap::mapping
