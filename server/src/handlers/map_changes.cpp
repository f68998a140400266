#include "bodies/maps_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"

namespace stillmap::server {
namespace {

HttpResponse put_map(const Context& context, const PathParameters& path) {
  check_name(path, "map");
  const std::string& name = path.at("map");
  const bool is_new = context.store.create_map(name);
  const StoredMap map = context.store.state().map(name);
  HttpResponse response = json_response(stored_map_json(map), is_new ? 201 : 200);
  response.headers.emplace_back("ETag", etag_of(map));
  if (is_new) response.headers.emplace_back("Location", "/v1/maps/" + name);
  return response;
}

HttpResponse remove_map(const Context& context, const HttpRequest& request,
                        const PathParameters& path) {
  const std::string& name = path.at("map");
  context.store.remove_map(
      name, flag_in_query(request, "active") ? WhenActive::kRemove : WhenActive::kRefuse);
  context.stats.forget(name);
  context.vehicles.forget(name);
  context.rollout_counts.forget(name);
  context.catalog.refresh();
  return {.status = 204, .content_type = {}, .body = {}, .headers = {}};
}

}  // namespace

void add_map_change_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"PUT", "/v1/maps/{map}",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return put_map(context, path);
                    },
                    Access::kWrite});
  routes.push_back({"DELETE", "/v1/maps/{map}",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return remove_map(context, request, path);
                    },
                    Access::kWrite});
}

}  // namespace stillmap::server
