#include "bodies/maps_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"

#include <stillmap/maps/error.hpp>

#include <stdexcept>

namespace stillmap::server {
namespace {

HttpResponse get_signatures(const Context& context, const PathParameters& path) {
  const StoredVersion version = context.store.state().version(path.at("map"), path.at("version"));
  HttpResponse response =
      json_response(signatures_text(context.store.signatures().of(path.at("map"), version.digest)));
  response.headers.emplace_back("Cache-Control", "no-cache");
  return response;
}

HttpResponse put_signatures(const Context& context, const HttpRequest& request,
                            const PathParameters& path) {
  require_json(request);
  const StoredVersion version = context.store.state().version(path.at("map"), path.at("version"));
  try {
    context.store.signatures().add(path.at("map"), version.digest,
                                   parse_signatures(request.body, "signatures"));
  } catch (const maps::InputError& error) {
    throw ApiError(ErrorCode::kInvalidRequest, error.what());
  } catch (const std::invalid_argument& error) {
    throw ApiError(ErrorCode::kInvalidRequest, error.what());
  }
  context.catalog.refresh();
  return get_signatures(context, path);
}

}  // namespace

void add_signature_routes(std::vector<Route>& routes, const Context& context) {
  const char* const pattern = "/v1/maps/{map}/versions/{version}/signatures";
  routes.push_back({"GET", pattern, [&context](const HttpRequest&, const PathParameters& path) {
                      return get_signatures(context, path);
                    }});
  routes.push_back({"PUT", pattern,
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return put_signatures(context, request, path);
                    },
                    Access::kWrite, BodyKind::kWhole, kMostSignaturesBytes});
}

}  // namespace stillmap::server
