#pragma once

#include <stillmap/localization/aligner.hpp>

#include <Eigen/Core>

#include <memory>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Defaults are what users of PCL write for a street: they let it converge from about 1 m.
struct PclIcpOptions {
  /// Edge of the voxel grid that thins scan and map [m], > 0. Half of it is slower and no more
  /// robust.
  double leaf_m = 0.5;
  /// Pairs farther apart are not used [m], > 0.
  double max_pair_distance_m = 2.0;
  /// > 0
  int max_iterations = 60;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// PCL's IterativeClosestPoint (point to point, SVD) behind our interface: the yardstick, not a
/// product.
///
/// Status is what PCL says (`hasConverged`, which it says of nearly everything); it gives no
/// covariance, so the covariance is zero. Inlier ratio and rmse count scan points with a map point
/// within one leaf.
class PclIcpAligner : public localization::Aligner {
 public:
  /// @throws std::invalid_argument on broken options, or without points.
  PclIcpAligner(const std::vector<Eigen::Vector3d>& points_map, const PclIcpOptions& options);
  ~PclIcpAligner() override;
  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud& scan_lidar,
      const std::optional<localization::Prior>& given) const override;

 private:
  struct Target;
  std::unique_ptr<const Target> target_;
  PclIcpOptions options_;
};

}  // namespace stillmap::mapping
