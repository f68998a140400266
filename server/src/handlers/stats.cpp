#include "bodies/stats_json.hpp"
#include "context.hpp"

namespace stillmap::server {

void add_stats_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back(
      {"GET", "/v1/maps/{map}/stats", [&context](const HttpRequest&, const PathParameters& path) {
         const std::string name = context.store.state().map(path.at("map")).name;
         return json_response(
             map_stats_json(name, context.stats.figures(name), context.sessions.count_on(name)));
       }});
}

}  // namespace stillmap::server
