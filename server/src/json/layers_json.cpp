#include "json/layers_json.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {

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
