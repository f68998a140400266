#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/options.hpp>

#include <memory>
#include <optional>
#include <vector>

namespace stillmap::localization {

class PlaceSearch;
struct Query;

/// The default aligner. A query goes through it once, from top to bottom: find candidates, refine
/// them, deskew the scan, refine the best one, judge it. See localization/how_it_works.md.
class VoxelAligner : public Aligner {
 public:
  /// @param seen_from  where scans are looked for; empty: where the index knows of.
  /// @throws std::invalid_argument if `index` is null, a pose is not finite or an option is broken.
  VoxelAligner(std::shared_ptr<const MapIndex> index,
               const std::vector<Eigen::Isometry3d>& seen_from, const LocalizationOptions& options);
  ~VoxelAligner() override;
  [[nodiscard]] AlignmentResult align(const maps::PointCloud& scan_lidar,
                                      const std::optional<Prior>& prior) const override;
  [[nodiscard]] ThinScan thin(const ScanView& scan_lidar) const override;
  [[nodiscard]] AlignmentResult align_thin(const ThinScan& scan_lidar,
                                           const std::optional<Prior>& prior) const override;

 private:
  [[nodiscard]] AlignmentResult align_near(const ThinScan& scan_lidar, const Prior& prior) const;
  [[nodiscard]] AlignmentResult align_anywhere(const ThinScan& scan_lidar) const;
  /// @param starts  `T_map_lidar`, at least one. @param prior  may be null.
  [[nodiscard]] AlignmentResult align_from(const std::vector<Eigen::Isometry3d>& starts,
                                           const Query& thinned, const Prior* prior) const;

  std::shared_ptr<const MapIndex> index_;
  LocalizationOptions options_;
  /// Null when nobody says where the map was seen from.
  std::unique_ptr<const PlaceSearch> places_;
};

}  // namespace stillmap::localization
