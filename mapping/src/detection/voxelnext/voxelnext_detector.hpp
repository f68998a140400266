#pragma once

#include "detection/voxelnext/network.hpp"
#include "detection/voxelnext/weights.hpp"

#include <stillmap/mapping/detector.hpp>

namespace stillmap::mapping {

/// Objects by the sparse voxel network VoxelNeXt, see `VoxelNext`.
///
/// With z = ground in the weights' config, points and boxes over places without known ground are
/// left out. Runs on the threads of the caller's arena; the same bits for any number of them.
class VoxelNextDetector final : public Detector {
 public:
  /// @throws std::invalid_argument naming what does not fit in config or layers.
  explicit VoxelNextDetector(const VoxelNextWeights& weights);
  [[nodiscard]] std::vector<maps::Box> detect(const maps::Scan& scan,
                                              const GroundResult& ground) const override;
  /// The same, shown step by step.
  [[nodiscard]] std::vector<maps::Box> detect(const maps::Scan& scan, const GroundResult& ground,
                                              const NetworkObserver& observer) const;

 private:
  VoxelNextConfig config_;
  VoxelNext network_;
};

}  // namespace stillmap::mapping
