#pragma once

#include "drives/drive_set.hpp"

#include <stillmap/mapping/trajectory.hpp>
#include <stillmap/maps/map_graph.hpp>

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// Key frames and loops as the drives number their own scans.
struct DriveGraph {
  struct Loop {
    DriveSet::Place from, to;
    double weight = 1.0;
  };
  std::vector<DriveSet::Place> key_frames;
  std::vector<Loop> loops;
};

[[nodiscard]] DriveGraph drive_graph_of(const TrajectoryEstimate& estimate);

/// The same by the numbers of a map's poses. A scan that is not in the map (held back, or left out
/// by the selection) is spoken for by the nearest one of its drive, the earlier of two.
[[nodiscard]] maps::MapGraph map_graph_of(const DriveSet& drives, const DriveGraph& graph);

}  // namespace stillmap::mapping
