#pragma once

#include "evaluation/detector/box_matching.hpp"

#include <stillmap/mapping/detector_evaluation.hpp>

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// The curve of all scans, a place for each score that occurs, from the highest down, and its mean
/// as `AveragePrecision` says it.
[[nodiscard]] AveragePrecision average_precision(const std::vector<ScanBoxes>& scans,
                                                 const ClassGroup& group, const Window& window,
                                                 double iou);

/// Mean of the best precision at each of 40 recalls or more.
/// @param curve  recalls ascending.
[[nodiscard]] double mean_of_40_recalls(const std::vector<PrecisionRecall>& curve);

}  // namespace stillmap::mapping
