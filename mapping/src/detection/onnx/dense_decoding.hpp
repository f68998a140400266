#pragma once

#include "detection/onnx/dense_input.hpp"
#include "detection/onnx/onnx_config.hpp"

#include <stillmap/maps/box.hpp>

#include <cstddef>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// What a network says with one head. Channels, then rows, then columns, as in OnnxHead.
struct HeadOutputs {
  std::span<const float> heat_map, offset, height, size, rotation;
};

/// Boxes with more of these in a head are those with the highest scores: what comes next is
/// quadratic, and a network that knows nothing marks every cell.
inline constexpr std::size_t kMostBoxesOfHead = 4096;

/// Boxes of the cells and classes whose score is at least the config's threshold, ascending by
/// cell, then class; with `peaks_only` those alone that no cell of the 3x3 around surpasses (of
/// equal ones all stay). Left out are those where the network gave no finite numbers or no size >
/// 0, and with z = ground those over whose centre no ground is known.
/// @throws maps::InputError for scores outside [0, 1] that are not logits.
/// @see Yin, Zhou, Kraehenbuehl, "Center-based 3D object detection and tracking", CVPR 2021,
///      section 4: centre = (cell + offset) * stride * cell size + range minimum.
[[nodiscard]] std::vector<maps::Box> decode_dense(const OnnxConfig& config, const OnnxHead& head,
                                                  const HeadOutputs& outputs,
                                                  const NetworkHeight& z);

}  // namespace stillmap::mapping
