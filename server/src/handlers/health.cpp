#include "context.hpp"
#include "json/answers_json.hpp"

#include <string>

namespace stillmap::server {
namespace {

std::string described(const ServedVersion& version) {
  return "map " + version.map + " version " + version.version;
}

/// Ready means that no active version is still being loaded: one that failed does not take the
/// others down.
HttpResponse answer_ready(const Context& context) {
  if (context.stopping) return json_response(status_json("stopping", {"stopping"}), 503);
  std::vector<std::string> loading;
  std::vector<std::string> failed;
  for (const ServedVersion& map : context.catalog.active()) {
    if (map.state == MapState::kFailed) {
      failed.push_back(described(map) + ": " + map.failure);
    } else if (map.state != MapState::kReady) {
      loading.push_back(described(map) + ": loading");
    }
  }
  for (const ServedVersion& map : context.catalog.waiting())
    if (map.state == MapState::kFailed)
      failed.push_back(described(map) + ": " + map.failure + "; the one before goes on");
  if (!loading.empty()) return json_response(status_json("loading", loading), 503);
  return json_response(status_json("ready", failed));
}

HttpResponse answer_map_ready(const MapCatalog& catalog, const std::string& name) {
  for (const ServedVersion& map : catalog.active()) {
    if (map.map != name) continue;
    if (map.state == MapState::kReady) return json_response(status_json("ready", {}));
    if (map.state == MapState::kFailed)
      return json_response(status_json("failed", {map.failure}), 503);
    return json_response(status_json("loading", {described(map) + ": loading"}), 503);
  }
  (void)catalog.find(name);  // says why there is none
  return json_response(status_json("loading", {}), 503);
}

HttpResponse answer_status(const Context& context) {
  const std::chrono::duration<double> uptime = std::chrono::steady_clock::now() - context.started;
  return json_response(server_status_json({.version = STILLMAP_VERSION,
                                           .maps = context.catalog.active().size(),
                                           .uptime_s = uptime.count(),
                                           .workers = context.workers},
                                          *context.live.current()));
}

}  // namespace

void add_health_routes(std::vector<Route>& routes, const Context& context) {
  const Handler alive = [](const HttpRequest&, const PathParameters&) {
    return json_response(status_json("alive", {}));
  };
  routes.push_back({"GET", "/livez", alive, Access::kOpen});
  routes.push_back({"GET", "/healthz", alive, Access::kOpen});
  routes.push_back(
      {"GET", "/readyz",
       [&context](const HttpRequest&, const PathParameters&) { return answer_ready(context); },
       Access::kOpen});
  routes.push_back({"GET", "/v1/maps/{map}/ready",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return answer_map_ready(context.catalog, path.at("map"));
                    },
                    Access::kOpen});
  routes.push_back({"GET", "/v1/status", [&context](const HttpRequest&, const PathParameters&) {
                      return answer_status(context);
                    }});
}

}  // namespace stillmap::server
