#include "api_error.hpp"
#include "context.hpp"
#include "json/answers_json.hpp"

namespace stillmap::server {
namespace {

/// What a version holds never changes.
HttpResponse immutable_json(std::string body) {
  HttpResponse response = json_response(std::move(body));
  response.headers.emplace_back("Cache-Control", "public, max-age=31536000, immutable");
  return response;
}

}  // namespace

ServedMap find_version(const MapCatalog& catalog, const PathParameters& path) {
  ServedMap map = catalog.find(path.at("map"));
  const auto version = path.find("version");
  if (version != path.end() && version->second != map.version()) {
    throw ApiError(
        ErrorCode::kUnknownVersion,
        "map '" + map.name + "' has version " + map.version() + ", not '" + version->second + "'");
  }
  return map;
}

void add_map_routes(std::vector<Route>& routes, const Context& context) {
  const MapCatalog& catalog = context.catalog;
  routes.push_back({"GET", "/v1/maps", [&catalog](const HttpRequest&, const PathParameters&) {
                      return json_response(map_list_json(catalog.maps(), catalog.refused()));
                    }});
  routes.push_back(
      {"GET", "/v1/maps/{map}", [&catalog](const HttpRequest&, const PathParameters& path) {
         const ServedMap map = catalog.find(path.at("map"));
         return json_response(map_json(map.name, *map.package));
       }});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/trajectory",
                    [&catalog](const HttpRequest&, const PathParameters& path) {
                      const ServedMap map = find_version(catalog, path);
                      return immutable_json(trajectories_json(map.package->trajectories()));
                    }});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/objects",
                    [&catalog](const HttpRequest&, const PathParameters& path) {
                      const ServedMap map = find_version(catalog, path);
                      return immutable_json(objects_json(map.package->objects()));
                    }});
}

}  // namespace stillmap::server
