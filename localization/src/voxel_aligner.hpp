#pragma once

#include "pose_search.hpp"

#include <stillmap/localization/aligner.hpp>

#include <memory>

namespace stillmap::localization {

/// The default aligner: search around the prior on coarse cells, Gauss-Newton on distributions from
/// coarse to fine with a kernel that narrows, then the verdict. See localization/README.md.
class VoxelAligner : public Aligner {
 public:
  /// @throws std::invalid_argument if `index` is null.
  explicit VoxelAligner(std::shared_ptr<const MapIndex> index);
  [[nodiscard]] AlignmentResult align(const maps::PointCloud& scan_lidar,
                                      const Prior& prior) const override;

 private:
  std::shared_ptr<const MapIndex> index_;
};

}  // namespace stillmap::localization
