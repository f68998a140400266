#pragma once

#include "views/range_view.hpp"

#include <Eigen/Geometry>

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

namespace stillmap::mapping {

/// How far a scan's pose disagrees with those around it, in length and angle.
struct PoseDoubt {
  float m = 0.0F;
  float rad = 0.0F;

  /// Of a point so far from the sensor [m].
  [[nodiscard]] float at(float range_m) const { return m + rad * range_m; }
};

/// The range views of scans with their poses, in the order of the scans.
struct PosedViews {
  /// One a scan; "local" as in `PosedScan`.
  std::vector<Eigen::Isometry3d> T_local_lidar;
  /// One a scan, or empty: all poses agree.
  std::vector<PoseDoubt> doubts{};
  /// The view of a scan by ordinal; called from several threads at once.
  std::function<std::shared_ptr<const RangeView>(std::size_t scan)> read;
};

}  // namespace stillmap::mapping
