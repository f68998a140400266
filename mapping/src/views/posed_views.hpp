#pragma once

#include "views/range_view.hpp"

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
  /// The view of a scan by ordinal; called from several threads at once.
  std::function<std::shared_ptr<const RangeView>(std::size_t scan)> read;
};

}  // namespace stillmap::mapping
