#pragma once

#include <stillmap/maps/map_graph.hpp>

#include <string>

namespace stillmap::server {

/// Key frames and loops of a version.
struct ShownGraph {
  /// Whether the build wrote them down; else key frames are derived from the poses.
  bool is_of_the_build = false;
  maps::MapGraph graph{};
  /// False where there may have been loops that nobody wrote down.
  bool knows_loops = true;
};
[[nodiscard]] std::string graph_json(const ShownGraph& graph);

}  // namespace stillmap::server
