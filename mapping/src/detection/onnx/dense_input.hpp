#pragma once

#include "detection/onnx/onnx_config.hpp"
#include "detection/onnx/onnx_session.hpp"
#include "detection/voxelnext/voxels.hpp"

#include <stillmap/maps/scan.hpp>

#include <vector>

namespace stillmap::mapping {

/// The tensor [1, channels, rows, columns] of `config.bev`.
[[nodiscard]] OnnxTensor bev_tensor(const OnnxConfig& config, const maps::PointCloud& cloud,
                                    const NetworkHeight& z);

struct Pillars {
  /// [P, most_points, features]
  OnnxTensor points;
  /// [P, 4] and [P], of int64; see PillarInput.
  OnnxTensor cells, counts;
};

/// The tensors of `config.pillars`, ascending by row, then column; a pillar's points in the order
/// of the scan.
[[nodiscard]] Pillars pillar_tensors(const OnnxConfig& config, const maps::PointCloud& cloud,
                                     const NetworkHeight& z);

}  // namespace stillmap::mapping
