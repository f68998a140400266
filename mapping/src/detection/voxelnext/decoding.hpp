#pragma once

#include "detection/voxelnext/feature_rows.hpp"
#include "detection/voxelnext/network.hpp"
#include "detection/voxelnext/sites.hpp"
#include "detection/voxelnext/voxels.hpp"
#include "detection/voxelnext/weights.hpp"

#include <stillmap/maps/box.hpp>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// A cell that may hold an object of a class.
struct Candidate {
  /// Number of the cell.
  std::uint32_t cell = 0;
  /// Class within the head.
  std::size_t head_class = 0;
  /// Calibrated.
  double probability = 0.0;
};

/// Cells and classes whose p = sigmoid(scale * logit + shift) may give a score of at least the
/// config's threshold;
/// with kMaxPool only those where no active cell of the 3x3 around has a larger logit of the class
/// ("sparse max pooling", section 3.3; of equal ones all stay, as there). Classes that are no
/// object for us are left out.
/// @return ascending by cell, then class.
[[nodiscard]] std::vector<Candidate> find_candidates(const VoxelNextConfig& config,
                                                     std::size_t head, const SiteSet& cells,
                                                     const FeatureRows& logits);

/// Boxes of candidates, lidar frame. Left out are those whose score p^(1-a) * iou^a is below the
/// threshold (OpenPCDet compares p with it, before the IoU is in), those where the network gave no
/// finite numbers, and with z = ground those over whose centre no ground is known.
/// @param at  with every cell of `candidates`.
[[nodiscard]] std::vector<maps::Box> decode_boxes(const VoxelNextConfig& config, std::size_t head,
                                                  const std::vector<Candidate>& candidates,
                                                  const SiteSet& cells, const HeadBoxes& at,
                                                  const NetworkHeight& height);

}  // namespace stillmap::mapping
