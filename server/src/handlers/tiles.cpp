#include "context.hpp"
#include "errors/api_error.hpp"
#include "http/header_text.hpp"
#include "json/tile_diff_json.hpp"

#include <fmt/format.h>

#include <charconv>
#include <span>
#include <string>
#include <utility>

namespace stillmap::server {
namespace {

/// 20,000 ids of the longest names take a half.
constexpr std::uint64_t kMostDiffBytes = std::uint64_t{4} << 20U;

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

maps::TileId read_tile_id(const PathParameters& path) {
  return {.level = read_coordinate<std::uint32_t>(path, "level"),
          .x = read_coordinate<std::int32_t>(path, "x"),
          .y = read_coordinate<std::int32_t>(path, "y")};
}

HttpResponse answer_tile(MapCatalog& catalog, const HttpRequest& request,
                         const PathParameters& path) {
  const ServedVersion map = find_version(catalog, path);
  const maps::TileId id = read_tile_id(path);
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

/// To where the active version has it: the tile there may be kept for ever, this answer not.
HttpResponse redirect_tile(const MapCatalog& catalog, const PathParameters& path) {
  const ServedVersion map = catalog.find(path.at("map"));
  const maps::TileId id = read_tile_id(path);
  HttpResponse response{.status = 307, .content_type = {}, .body = {}, .headers = {}};
  response.headers = {{"Location", fmt::format("/v1/maps/{}/versions/{}/tiles/{}/{}/{}", map.map,
                                               map.version, id.level, id.x, id.y)},
                      {"Cache-Control", "no-cache"}};
  return response;
}

HttpResponse answer_diff(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  if (const std::string type = media_type(request.header("content-type"));
      type != "application/json") {
    throw field_error(ErrorCode::kUnsupportedMediaType, "Content-Type", "'" + type + "'",
                      "application/json");
  }
  const TileDiffRequest wanted = read_tile_diff_json(request.body, context.options);
  const ServedVersion map = std::as_const(context.catalog).find(path.at("map"));
  return json_response(tile_diff_json(tile_diff(map, wanted)));
}

}  // namespace

void add_tile_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/tiles/{level}/{x}/{y}",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return answer_tile(context.catalog, request, path);
                    }});
  routes.push_back({"GET", "/v1/maps/{map}/tiles/{level}/{x}/{y}",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return redirect_tile(context.catalog, path);
                    }});
  routes.push_back({"POST", "/v1/maps/{map}/tiles/diff",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return answer_diff(context, request, path);
                    },
                    Access::kRead, BodyKind::kWhole, kMostDiffBytes});
}

}  // namespace stillmap::server
