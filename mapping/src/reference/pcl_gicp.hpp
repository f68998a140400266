#pragma once

#include <stillmap/localization/aligner.hpp>

#include <Eigen/Core>

#include <memory>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Defaults are those of `PclIcpOptions`; everything else is as PCL sets it (20 neighbours for a
/// covariance, epsilon 5e-4).
struct PclGicpOptions {
  /// Edge of the voxel grid that thins scan and map [m], > 0.
  double leaf_m = 0.5;
  /// Pairs farther apart are not used [m], > 0.
  double max_pair_distance_m = 2.0;
  /// > 0
  int max_iterations = 60;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// PCL's GeneralizedIterativeClosestPoint behind our interface; the map's covariances are computed
/// once. Status and figures as in `PclIcpAligner`.
class PclGicpAligner : public localization::Aligner {
 public:
  /// @param points_map  at least 20 points are left after thinning.
  /// @throws std::invalid_argument on broken options, or with too few points.
  PclGicpAligner(const std::vector<Eigen::Vector3d>& points_map, const PclGicpOptions& options);
  ~PclGicpAligner() override;
  /// A scan with fewer than 20 points after thinning has no covariances: `lost`, `too_few_points`.
  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud& scan_lidar,
      const std::optional<localization::Prior>& given) const override;

 private:
  struct Target;
  std::unique_ptr<const Target> target_;
  PclGicpOptions options_;
};

}  // namespace stillmap::mapping
