#include "bodies/rollout_json.hpp"
#include "context.hpp"
#include "handlers/page_query.hpp"

namespace stillmap::server {
namespace {

/// @param rollout  of its map, if there is one.
HttpResponse answer(const Context& context, const std::string& map,
                    const std::optional<Rollout>& rollout) {
  if (!rollout) return json_response(no_rollout_json(map));
  const auto version = context.catalog.known(map, rollout->version);
  return json_response(rollout_json(*rollout, context.rollout_counts.figures(*rollout),
                                    version ? name_of(version->state) : "stored"));
}

HttpResponse show_rollout(const Context& context, const PathParameters& path) {
  const std::string map = context.store.state().map(path.at("map")).name;
  return answer(context, map, context.catalog.rollout(map));
}

HttpResponse put_rollout(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  require_json(request);
  Rollout wanted = read_rollout_json(request.body);
  wanted.map = path.at("map");
  wanted.begun_ns = unix_ns();
  return answer(context, wanted.map, context.catalog.put_rollout(wanted));
}

HttpResponse end_rollout(const Context& context, const PathParameters& path) {
  context.catalog.end_rollout(path.at("map"));
  return {.status = 204, .content_type = {}, .body = {}, .headers = {}};
}

HttpResponse list_vehicles(const Context& context, const HttpRequest& request,
                           const PathParameters& path) {
  const auto values = read_query(request, {"limit", "after"});
  const std::size_t most = read_page(values).limit;
  const auto after = values.find("after");
  const std::string map = context.store.state().map(path.at("map")).name;
  // One more tells whether the list goes on.
  std::vector<VehicleTable::Vehicle> vehicles =
      context.vehicles.list(map, after == values.end() ? "" : after->second, most + 1);
  std::optional<std::string> next;
  if (vehicles.size() > most) {
    vehicles.pop_back();
    next = vehicles.back().label;
  }
  return json_response(vehicle_list_json(vehicles, next));
}

}  // namespace

void add_rollout_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back(
      {"GET", "/v1/maps/{map}/rollout", [&context](const HttpRequest&, const PathParameters& path) {
         return show_rollout(context, path);
       }});
  routes.push_back({"PUT", "/v1/maps/{map}/rollout",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return put_rollout(context, request, path);
                    },
                    Access::kWrite, BodyKind::kWhole, kMostRolloutJson});
  routes.push_back({"DELETE", "/v1/maps/{map}/rollout",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return end_rollout(context, path);
                    },
                    Access::kWrite});
  routes.push_back({"GET", "/v1/maps/{map}/vehicles",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return list_vehicles(context, request, path);
                    }});
}

}  // namespace stillmap::server
