#pragma once

#include <memory>
#include <span>
#include <vector>

#include "roads/path.hpp"
#include "roads/road_network.hpp"

namespace stillmap::simulation {

/// An edge as it is driven.
struct Leg {
  std::size_t edge = 0;
  /// From its `from` node to its `to` node.
  bool forward = true;
};

/// Line before a crossing at which one waits.
struct StopLine {
  double station_m = 0.0;
  std::size_t node = 0;
  /// Edge one comes from.
  std::size_t edge = 0;
};

/// A way through the network on the right-hand lanes.
struct Route {
  std::shared_ptr<const Path> path;
  std::vector<StopLine> stops;
  /// Where on it one starts [m].
  double start_m = 2.0;
};

/// @param lane  0 = next to the middle line. Each leg starts where the one before ends.
[[nodiscard]] Route make_route(const RoadNetwork& network, std::span<const Leg> legs, int lane);

/// Legs through these nodes, neighbours in the network.
[[nodiscard]] std::vector<Leg> legs_through(const RoadNetwork& network,
                                            std::span<const std::size_t> nodes);

/// Middle of a lane, to the left of the edge's middle line when driven forward [m].
[[nodiscard]] double lane_offset_m(const RoadSection& section, int lane, bool forward);

}  // namespace stillmap::simulation
