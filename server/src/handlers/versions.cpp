#include "bodies/maps_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"

#include <charconv>

namespace stillmap::server {
namespace {

/// The revision of If-Match, when the client sent one. @throws ApiError.
std::optional<std::int64_t> wanted_revision(const HttpRequest& request) {
  const std::string text = request.header("if-match");
  if (text.empty() || text == "*") return std::nullopt;
  std::int64_t revision = 0;
  const char* const begin = text.data() + 1;
  const char* const end = text.data() + text.size() - 1;
  const bool quoted = text.size() > 2 && text.front() == '"' && text.back() == '"';
  if (quoted) {
    const auto [stop, error] = std::from_chars(begin, end, revision);
    if (error == std::errc{} && stop == end && revision >= 0) return revision;
  }
  throw field_error(ErrorCode::kInvalidRequest, "If-Match", "'" + text + "'",
                    "the ETag of the map, such as \"3\"");
}

HttpResponse answer_map(const StoredMap& map, int status = 200) {
  HttpResponse response = json_response(stored_map_json(map), status);
  response.headers.emplace_back("ETag", etag_of(map));
  return response;
}

HttpResponse activate(const Context& context, const HttpRequest& request,
                      const PathParameters& path) {
  return answer_map(context.catalog.activate(path.at("map"), path.at("version"),
                                             wanted_revision(request),
                                             flag_in_query(request, "new_frame")));
}

HttpResponse roll_back(const Context& context, const HttpRequest& request,
                       const PathParameters& path) {
  return answer_map(context.catalog.roll_back(path.at("map"), wanted_revision(request),
                                              flag_in_query(request, "new_frame")));
}

HttpResponse remove_version(const Context& context, const PathParameters& path) {
  context.store.remove(path.at("map"), path.at("version"));
  return {.status = 204, .content_type = {}, .body = {}, .headers = {}};
}

HttpResponse list_versions(const Context& context, const PathParameters& path) {
  const StoreState& state = context.store.state();
  const StoredMap map = state.map(path.at("map"));
  std::vector<DescribedVersion> versions;
  for (const StoredVersion& version : state.versions(map.name))
    versions.push_back(describe_version(context, map.name, version));
  HttpResponse response = json_response(version_list_json(map, versions));
  response.headers.emplace_back("ETag", etag_of(map));
  return response;
}

}  // namespace

void add_version_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"GET", "/v1/maps/{map}/versions",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return list_versions(context, path);
                    }});
  routes.push_back({"DELETE", "/v1/maps/{map}/versions/{version}",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return remove_version(context, path);
                    },
                    Access::kWrite});
  routes.push_back({"POST", "/v1/maps/{map}/versions/{version}/activate",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return activate(context, request, path);
                    },
                    Access::kWrite});
  routes.push_back({"POST", "/v1/maps/{map}/rollback",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return roll_back(context, request, path);
                    },
                    Access::kWrite});
}

}  // namespace stillmap::server
