#pragma once

#include <stillmap/localization/aligner.hpp>

#include <memory>
#include <optional>
#include <vector>

namespace stillmap::localization {

class PlaceSearch;

/// The default aligner: search around the prior, or over the whole map, on coarse cells;
/// Gauss-Newton on distributions from coarse to fine with a kernel that narrows; then the verdict.
/// See localization/how_it_works.md.
class VoxelAligner : public Aligner {
 public:
  /// @throws std::invalid_argument if `index` is null or a pose is not finite.
  VoxelAligner(std::shared_ptr<const MapIndex> index,
               const std::vector<Eigen::Isometry3d>& seen_from);
  ~VoxelAligner() override;
  [[nodiscard]] AlignmentResult align(const maps::PointCloud& scan_lidar,
                                      const std::optional<Prior>& prior) const override;

 private:
  [[nodiscard]] AlignmentResult align_near(const maps::PointCloud& scan_lidar,
                                           const Prior& prior) const;
  [[nodiscard]] AlignmentResult align_anywhere(const maps::PointCloud& scan_lidar) const;

  std::shared_ptr<const MapIndex> index_;
  /// Null when nobody says where the map was seen from.
  std::unique_ptr<const PlaceSearch> places_;
};

}  // namespace stillmap::localization
