#pragma once

#include "views/range_view.hpp"

#include <stillmap/maps/pose_disagreement.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

namespace stillmap::mapping {

/// The range views of scans with their poses, in the order of the scans.
struct PosedViews {
  /// One a scan; "local" as in `PosedScan`.
  std::vector<Eigen::Isometry3d> T_local_lidar;
  /// One a scan, or empty: all poses agree.
  std::vector<maps::PoseDisagreement> doubts{};
  /// The view of a scan by ordinal; called from several threads at once.
  std::function<std::shared_ptr<const RangeView>(std::size_t scan)> read;
};

}  // namespace stillmap::mapping
