#include "catalog/map_views.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"
#include "handlers/tile_answer.hpp"
#include "handlers/tile_path.hpp"

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <utility>

namespace stillmap::server {
namespace {

/// Told apart from what another format of the levels was served as.
constexpr const char* kTilesetForm = "-3dtiles-1";
constexpr const char* kGlbForm = "-glb-2";

[[noreturn]] void refuse(const ServedVersion& map, const HttpRequest& request) {
  throw ApiError(ErrorCode::kUnknownTile, "map '" + map.map + "' has nothing at " + request.path);
}

/// Tilesets are asked for anew each time, since how levels are made may change with the server.
HttpResponse tileset_answer(const HttpRequest& request, const std::string& etag,
                            const std::function<std::string()>& text) {
  HttpResponse response = json_response({});
  response.headers = {{"ETag", etag}, {"Cache-Control", "no-cache"}};
  if (is_known_to_client(request.header("if-none-match"), etag)) {
    response.status = 304;
  } else {
    response.body = text();
  }
  return response;
}

HttpResponse get_tileset(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  const ServedVersion map = find_version(context.catalog, path);
  const std::shared_ptr<const ServedLevels> served = context.views.levels(map);
  return tileset_answer(request, "\"" + map.package->digest().substr(0, 16) + kTilesetForm + "\"",
                        [&] { return served->tileset.text(); });
}

HttpResponse get_cut(const Context& context, const HttpRequest& request,
                     const PathParameters& path) {
  const ServedVersion map = find_version(context.catalog, path);
  const maps::TileId id = read_tile_id(path);
  if (!lies_above_points(*map.package, id)) refuse(map, request);
  const std::shared_ptr<const ServedLevels> served = context.views.levels(map);
  const auto& cuts = served->tileset.cuts();
  if (!std::binary_search(cuts.begin(), cuts.end(), id)) refuse(map, request);
  return tileset_answer(request, tile_etag(map, kTilesetForm, id),
                        [&] { return served->tileset.cut_text(id); });
}

/// Level 0 as it lies in the package.
HttpResponse own_tile(const Context& context, const ServedVersion& map, const HttpRequest& request,
                      maps::TileId id) {
  const std::optional<maps::TileEntry> tile = map.package->entry(id);
  if (!tile) refuse(map, request);
  return immutable_answer(request, tile_etag(map, kGlbForm, id), [&](HttpResponse& response) {
    fill_with_glb(response, *tile, context.views.own_tile(map, id));
  });
}

HttpResponse get_glb(const Context& context, const HttpRequest& request,
                     const PathParameters& path) {
  const ServedVersion map = find_version(context.catalog, path);
  const maps::TileId id = read_tile_id(path);
  if (id.level == 0) return own_tile(context, map, request, id);
  if (!lies_above_points(*map.package, id)) refuse(map, request);
  std::optional<LevelTile> tile = context.views.level_tile(map, id);
  if (!tile) refuse(map, request);
  return immutable_answer(request, tile_etag(map, kGlbForm, id), [&](HttpResponse& response) {
    fill_with_glb(response, tile->entry, std::move(tile->points));
  });
}

}  // namespace

void add_tileset_routes(std::vector<Route>& routes, const Context& context) {
  const auto add = [&](const char* place, auto handler) {
    routes.push_back({"GET", std::string("/v1/maps/{map}/versions/{version}/3dtiles/") + place,
                      [&context, handler](const HttpRequest& request, const PathParameters& path) {
                        return handler(context, request, path);
                      }});
  };
  add("tileset.json", get_tileset);
  add("{level}/{x}/{y}.glb", get_glb);
  add("{level}/{x}/{y}.json", get_cut);
}

}  // namespace stillmap::server
