#include "api_error.hpp"
#include "context.hpp"

#include <charconv>
#include <span>
#include <string>

namespace stillmap::server {
namespace {

template <typename Integer>
Integer read_coordinate(const PathParameters& path, const char* name) {
  const std::string& text = path.at(name);
  Integer value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  // "007" and "7" would be two addresses of one tile.
  if (error != std::errc{} || end != text.data() + text.size() || std::to_string(value) != text) {
    throw ApiError(ErrorCode::kUnknownTile,
                   std::string(name) + ": found '" + text + "', expected an integer");
  }
  return value;
}

HttpResponse answer_tile(MapCatalog& catalog, const HttpRequest& request,
                         const PathParameters& path) {
  const ServedVersion map = find_version(catalog, path);
  const maps::TileId id{.level = read_coordinate<std::uint32_t>(path, "level"),
                        .x = read_coordinate<std::int32_t>(path, "x"),
                        .y = read_coordinate<std::int32_t>(path, "y")};
  const std::span<const maps::MapPoint> points = map.package->tile(id);
  if (points.empty()) {
    throw ApiError(ErrorCode::kUnknownTile, "map '" + map.map + "' has no tile at " + request.path);
  }
  const std::string etag = "\"" + map.package->digest().substr(0, 16) + "-" + path.at("level") +
                           "-" + path.at("x") + "-" + path.at("y") + "\"";
  HttpResponse response{.content_type = "application/octet-stream", .body = {}, .headers = {}};
  response.headers = {{"ETag", etag}, {"Cache-Control", "public, max-age=31536000, immutable"}};
  if (is_known_to_client(request.header("if-none-match"), etag)) {
    response.status = 304;
    return response;
  }
  const std::span<const std::byte> bytes = std::as_bytes(points);
  response.body.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  return response;
}

}  // namespace

void add_tile_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/tiles/{level}/{x}/{y}",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return answer_tile(context.catalog, request, path);
                    }});
}

}  // namespace stillmap::server
