#include "bodies/layers_json.hpp"
#include "catalog/map_layers.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"
#include "handlers/tile_answer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstring>

namespace stillmap::server {
namespace {

static_assert(std::endian::native == std::endian::little, "bands travel as they lie");

LayerKind kind_in(const PathParameters& path) {
  const std::string& name = path.at("layer");
  if (const auto kind = layer_kind_of(name)) return *kind;
  throw ApiError(ErrorCode::kUnknownLayer,
                 fmt::format("'{}' is no layer: coverage, localizability", name));
}

std::string layer_etag(const ServedVersion& version, const std::string& name) {
  return fmt::format("\"{}-{}-1\"", version.package->digest().substr(0, 16), name);
}

HttpResponse get_layer(const Context& context, const HttpRequest& request,
                       const PathParameters& path) {
  const ServedVersion version = find_version(context.catalog, path);
  const LayerKind kind = kind_in(path);
  const std::string name(name_of(kind));
  const std::string url =
      fmt::format("/v1/maps/{}/versions/{}/layers/{}", version.map, version.version, name);
  const auto layer = context.layers.layer(version, kind);
  return immutable_answer(request, layer_etag(version, name), [&](HttpResponse& response) {
    response.content_type = "application/json";
    response.body = layer_json(name, *layer, version.package->manifest().origin, url);
  });
}

HttpResponse get_band(const Context& context, const HttpRequest& request,
                      const PathParameters& path) {
  const ServedVersion version = find_version(context.catalog, path);
  const LayerKind kind = kind_in(path);
  const auto layer = context.layers.layer(version, kind);
  const std::string& name = path.at("band");
  const auto band = std::find_if(layer->bands.begin(), layer->bands.end(),
                                 [&](const auto& each) { return each.name == name; });
  if (band == layer->bands.end())
    throw ApiError(ErrorCode::kUnknownLayer,
                   fmt::format("the layer {} has no band '{}'", name_of(kind), name));
  const std::string etag = layer_etag(version, fmt::format("{}-{}", name_of(kind), name));
  return immutable_answer(request, etag, [&](HttpResponse& response) {
    response.content_type = "application/octet-stream";
    response.body.assign(reinterpret_cast<const char*>(band->values.data()),
                         band->values.size() * sizeof(float));
  });
}

}  // namespace

void add_layer_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/layers/{layer}",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return get_layer(context, request, path);
                    }});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/layers/{layer}/{band}",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return get_band(context, request, path);
                    }});
}

}  // namespace stillmap::server
