#include "bodies/sets_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"
#include "handlers/set_maps.hpp"

#include <algorithm>
#include <utility>

namespace stillmap::server {
namespace {

HttpResponse put_set(const Context& context, const HttpRequest& request,
                     const PathParameters& path) {
  check_name(path, "set");
  require_json(request);
  MapSet set = read_set_json(request.body);
  set.name = path.at("set");
  context.store.check_disk_reserve(request.body.size());
  const bool is_new = context.catalog.put_set(set);
  HttpResponse response = json_response(set_json(set), is_new ? 201 : 200);
  if (is_new) response.headers.emplace_back("Location", "/v1/sets/" + set.name);
  return response;
}

HttpResponse remove_set(const Context& context, const PathParameters& path) {
  const std::string& name = path.at("set");
  if (!context.catalog.remove_set(name))
    throw ApiError(ErrorCode::kUnknownSet, "there is no set '" + name + "' of maps");
  return {.status = 204, .content_type = {}, .body = {}, .headers = {}};
}

}  // namespace

void add_set_routes(std::vector<Route>& routes, const Context& context) {
  Route list{"GET", "/v1/sets",
             [&context](const HttpRequest& request, const PathParameters&) {
               return json_response(sets_json(seen_sets(context, request.caller)));
             },
             Access::kReadOrLocalize};
  Route show{"GET", "/v1/sets/{set}",
             [&context](const HttpRequest& request, const PathParameters& path) {
               return json_response(set_json(wanted_set(context, request.caller, path.at("set"))));
             },
             Access::kReadOrLocalize};
  list.limits_maps = show.limits_maps = true;
  routes.push_back(std::move(list));
  routes.push_back(std::move(show));
  // Of all maps at once: keys that are for some of them are refused.
  routes.push_back({"PUT", "/v1/sets/{set}",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return put_set(context, request, path);
                    },
                    Access::kWrite, BodyKind::kWhole, kMostSetJson});
  routes.push_back({"DELETE", "/v1/sets/{set}",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return remove_set(context, path);
                    },
                    Access::kWrite});
}

}  // namespace stillmap::server
