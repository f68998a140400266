#pragma once

#include <stillmap/maps/map_graph.hpp>
#include <stillmap/maps/tile_layer.hpp>

#include <Eigen/Core>

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

/// How a layer's bands lie, and where they are.
/// @param origin  of the map. @param url  of the layer.
[[nodiscard]] std::string layer_json(const std::string& name, const maps::TileLayer& layer,
                                     const Eigen::Vector3d& origin, const std::string& url);

}  // namespace stillmap::server
