#include "context.hpp"
#include "openapi_document.hpp"

#include <stillmap/maps/map_package.hpp>

namespace stillmap::server {

void add_openapi_routes(std::vector<Route>& routes) {
  const std::string etag = "\"" + maps::sha256_of(openapi_document()).substr(0, 16) + "\"";
  routes.push_back({"GET", "/openapi.json",
                    [etag](const HttpRequest& request, const PathParameters&) {
                      HttpResponse response = json_response({});
                      response.headers = {{"ETag", etag}, {"Cache-Control", "no-cache"}};
                      if (is_known_to_client(request.header("if-none-match"), etag)) {
                        response.status = 304;
                      } else {
                        response.body = std::string(openapi_document());
                      }
                      return response;
                    },
                    Access::kOpen});
}

}  // namespace stillmap::server
