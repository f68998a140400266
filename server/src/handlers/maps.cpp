#include "context.hpp"
#include "errors/api_error.hpp"
#include "json/answers_json.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

/// What a version holds never changes.
HttpResponse immutable_json(std::string body) {
  HttpResponse response = json_response(std::move(body));
  response.headers.emplace_back("Cache-Control", "public, max-age=31536000, immutable");
  return response;
}

HttpResponse answer_list(const Context& context) {
  const std::vector<ServedVersion> active = context.catalog.active();
  std::vector<ListedMap> maps;
  for (maps::StoredMap& map : context.store.state().maps()) {
    const auto served = std::find_if(active.begin(), active.end(),
                                     [&](const auto& each) { return each.map == map.name; });
    maps.push_back({std::move(map), std::nullopt});
    if (served != active.end()) maps.back().served = *served;
  }
  return json_response(map_list_json(maps, context.catalog.waiting()));
}

}  // namespace

void add_map_routes(std::vector<Route>& routes, const Context& context) {
  const Handler one = [&context](const HttpRequest&, const PathParameters& path) {
    const maps::StoredMap map = context.store.state().map(path.at("map"));
    // A map without an active version is there all the same.
    HttpResponse response = json_response(!map.active && !version_in(path)
                                              ? stored_map_json(map)
                                              : map_json(map, find_version(context.catalog, path)));
    response.headers.emplace_back("ETag", etag_of(map));
    return response;
  };
  routes.push_back({"GET", "/v1/maps", [&context](const HttpRequest&, const PathParameters&) {
                      return answer_list(context);
                    }});
  routes.push_back({"GET", "/v1/maps/{map}", one});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}", one});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/trajectory",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      const ServedVersion map = find_version(context.catalog, path);
                      return immutable_json(trajectories_json(map.package->trajectories()));
                    }});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/objects",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      const ServedVersion map = find_version(context.catalog, path);
                      return immutable_json(objects_json(map.package->objects()));
                    }});
}

}  // namespace stillmap::server
