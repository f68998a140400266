#include "management.hpp"

#include <string>
#include <vector>

namespace stillmap::server {
namespace {

std::vector<Route> own_routes(const Service& service) {
  std::vector<Route> routes;
  routes.push_back({"GET", "/metrics",
                    [&service](const HttpRequest&, const PathParameters&) {
                      return HttpResponse{.content_type = "text/plain; version=0.0.4",
                                          .body = service.metrics().text(),
                                          .headers = {}};
                    },
                    Access::kOpen});
  return routes;
}

bool is_health(const std::string& path) {
  return path == "/livez" || path == "/readyz" || path == "/healthz";
}

}  // namespace

Management::Management(const Service& service) : service_(service), router_(own_routes(service)) {}

Router::Match Management::find(const HttpRequest& request) const {
  return is_health(request.path) ? service_.find(request)
                                 : router_.match(request.method, request.path);
}

void Management::admit(HttpRequest& request, const Router::Match& match) const {
  if (!is_health(request.path)) return;
  service_.admit(request, match);
  // Who reaches this port watches the server.
  request.caller = {.may_read = true};
}

HttpResponse Management::handle(const HttpRequest& request, const Router::Match& match) const {
  return service_.handle(request, match);
}

}  // namespace stillmap::server
