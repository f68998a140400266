#include "context.hpp"
#include "json/answers_json.hpp"

#include <string>

namespace stillmap::server {
namespace {

/// Ready means that no map is still being loaded: one that failed does not take the others down.
HttpResponse answer_ready(const MapCatalog& catalog) {
  std::vector<std::string> loading;
  std::vector<std::string> failed;
  for (const ServedMap& map : catalog.maps()) {
    if (map.state == MapState::kLoading) loading.push_back("map " + map.name + ": loading");
    if (map.state == MapState::kFailed) failed.push_back("map " + map.name + ": " + map.failure);
  }
  if (!loading.empty()) return json_response(status_json("loading", loading), 503);
  return json_response(status_json("ready", failed));
}

HttpResponse answer_map_ready(const ServedMap& map) {
  switch (map.state) {
    case MapState::kReady:
      return json_response(status_json("ready", {}));
    case MapState::kFailed:
      return json_response(status_json("failed", {map.failure}), 503);
    case MapState::kLoading:
      break;
  }
  return json_response(status_json("loading", {"map " + map.name + ": loading"}), 503);
}

HttpResponse answer_status(const Context& context) {
  const std::chrono::duration<double> uptime = std::chrono::steady_clock::now() - context.started;
  return json_response(server_status_json({.version = STILLMAP_VERSION,
                                           .maps = context.catalog.maps().size(),
                                           .uptime_s = uptime.count(),
                                           .workers = context.workers},
                                          context.options));
}

}  // namespace

void add_health_routes(std::vector<Route>& routes, const Context& context) {
  const Handler alive = [](const HttpRequest&, const PathParameters&) {
    return json_response(status_json("alive", {}));
  };
  routes.push_back({"GET", "/livez", alive, Access::kOpen});
  routes.push_back({"GET", "/healthz", alive, Access::kOpen});
  routes.push_back({"GET", "/readyz",
                    [&context](const HttpRequest&, const PathParameters&) {
                      return answer_ready(context.catalog);
                    },
                    Access::kOpen});
  routes.push_back({"GET", "/v1/maps/{map}/ready",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return answer_map_ready(context.catalog.find(path.at("map")));
                    },
                    Access::kOpen});
  routes.push_back({"GET", "/v1/status", [&context](const HttpRequest&, const PathParameters&) {
                      return answer_status(context);
                    }});
}

}  // namespace stillmap::server
