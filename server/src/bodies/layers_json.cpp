#include "bodies/layers_json.hpp"

#include "json/json_values.hpp"

#include <cmath>
#include <utility>

namespace stillmap::server {

namespace {

/// With the range of its values, for a legend.
Json to_json(const maps::TileLayer::Band& band, const std::string& url) {
  Json least, most;
  for (const float value : band.values) {
    if (std::isnan(value)) continue;
    if (least.is_null() || value < least.get<float>()) least = value;
    if (most.is_null() || value > most.get<float>()) most = value;
  }
  return {{"name", band.name},
          {"unit", band.unit},
          {"min", std::move(least)},
          {"max", std::move(most)},
          {"url", url + "/" + band.name}};
}

}  // namespace

std::string layer_json(const std::string& name, const maps::TileLayer& layer,
                       const Eigen::Vector3d& origin, const std::string& url) {
  Json json{{"layer", name},
            {"tile_size_m", maps::kTileSizeM},
            {"cell_m", layer.cell_m()},
            {"cells_per_side", layer.cells_per_side},
            {"origin", to_json_array(origin)},
            {"tiles", Json::array()},
            {"bands", Json::array()}};
  for (const maps::TileId& tile : layer.tiles) json["tiles"].push_back({tile.x, tile.y});
  for (const maps::TileLayer::Band& band : layer.bands) json["bands"].push_back(to_json(band, url));
  return to_text(json);
}

std::string graph_json(const ShownGraph& shown) {
  Json json{{"source", shown.is_of_the_build ? "build" : "derived"},
            {"key_frames", shown.graph.key_frames},
            {"loops", Json()}};
  if (!shown.knows_loops) return to_text(json);
  json["loops"] = Json::array();
  for (const maps::MapGraph::Loop& loop : shown.graph.loops)
    json["loops"].push_back({{"from", loop.from}, {"to", loop.to}, {"weight", loop.weight}});
  return to_text(json);
}

}  // namespace stillmap::server
