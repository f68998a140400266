#pragma once

#include <stillmap/localization/aligner.hpp>

#include <Eigen/Core>

#include <memory>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Defaults are what users of PCL write for a street, but for the epsilon.
struct PclNdtOptions {
  /// Edge of the voxel grid that thins the scan [m], > 0. The map is taken as it is.
  double leaf_m = 0.5;
  /// Edge of the cells with a normal distribution each [m], > 0.
  double cell_m = 2.0;
  /// Longest step of the line search [m, rad], > 0.
  double step = 0.1;
  /// It has converged when the square of a step's translation is below [m^2], > 0. PCL's tutorial
  /// writes 0.01, which is the square of the longest step: every first step ends it.
  double epsilon_m2 = 1e-6;
  /// PCL's default, > 0.
  int max_iterations = 35;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// PCL's NormalDistributionsTransform behind our interface; the map's cells are made once.
///
/// PCL keeps the cells in the object that aligns, so threads wait for each other. Status and
/// figures as in `PclIcpAligner`.
class PclNdtAligner : public localization::Aligner {
 public:
  /// @throws std::invalid_argument on broken options, or without points.
  PclNdtAligner(const std::vector<Eigen::Vector3d>& points_map, const PclNdtOptions& options);
  ~PclNdtAligner() override;
  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud& scan_lidar,
      const std::optional<localization::Prior>& given) const override;

 private:
  struct Target;
  std::unique_ptr<Target> target_;
  PclNdtOptions options_;
};

}  // namespace stillmap::mapping
