#include "bodies/maps_json.hpp"
#include "bodies/tile_diff_json.hpp"
#include "catalog/map_views.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"
#include "handlers/page_query.hpp"
#include "handlers/pose_handling.hpp"
#include "handlers/tile_answer.hpp"
#include "handlers/tile_path.hpp"

#include <fmt/format.h>

#include <stillmap/maps/text.hpp>

#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::server {
namespace {

/// 20,000 ids of the longest names, 63 bytes and three numbers, take 1.9 MB.
constexpr std::uint64_t kMostDiffBytes = std::uint64_t{2} << 20U;
/// Some hundred ids, as a vehicle sends them. A longer body takes a place before it is read.
constexpr std::size_t kSmallDiffBytes = std::size_t{64} << 10U;
/// At one time, each of some 10 MiB with what is made of it.
constexpr int kMostLargeDiffs = 16;

[[noreturn]] void refuse_tile(const ServedVersion& map, const HttpRequest& request) {
  throw ApiError(ErrorCode::kUnknownTile, "map '" + map.map + "' has no tile at " + request.path);
}

/// Told apart from what other coordinates were served as.
constexpr const char* kPointsForm = "-points-2";

/// What a client adds to the points' coordinates, with as many digits as bring the doubles back.
std::string corner_text(const ServedVersion& map, maps::TileId id) {
  const Eigen::Vector3d corner = map.package->manifest().origin + maps::corner_of(id);
  return fmt::format("{}, {}, {}", corner.x(), corner.y(), corner.z());
}

/// Levels that the package itself does not hold are derived.
HttpResponse answer_tile(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  const ServedVersion map = find_version(context.catalog, path);
  const maps::TileId id = read_tile_id(path);
  std::optional<LevelTile> derived;
  if (!map.package->has_tile(id)) {
    if (lies_above_points(*map.package, id)) derived = context.views.level_tile(map, id);
    if (!derived) refuse_tile(map, request);
  }
  return immutable_answer(request, tile_etag(map, kPointsForm, id), [&](HttpResponse& response) {
    const std::vector<maps::MapPoint> points =
        derived ? std::move(derived->points) : context.views.own_tile(map, id);
    response.content_type = "application/octet-stream";
    response.headers.emplace_back("Stillmap-Tile-Corner", corner_text(map, id));
    const std::span<const std::byte> bytes = std::as_bytes(std::span(points));
    response.body.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  });
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
  require_json(request);
  const TileDiffRequest wanted = read_tile_diff_json(request.body, context.options);
  const ServedVersion map = std::as_const(context.catalog).find(path.at("map"));
  return json_response(tile_diff_json(tile_diff(map, wanted)));
}

Route diff_route(const Context& context) {
  Route route{"POST",
              "/v1/maps/{map}/tiles/diff",
              [&context](const HttpRequest& request, const PathParameters& path) {
                return answer_diff(context, request, path);
              },
              Access::kRead,
              BodyKind::kWhole,
              kMostDiffBytes};
  // Not among the bodies with scans: whoever reads tiles must not keep vehicles from their poses.
  route.reserve = [&context, places = std::make_shared<SharedPlaces>()](
                      const HttpRequest& request, const PathParameters&) -> std::shared_ptr<void> {
    if (body_bytes(context, request) <= kSmallDiffBytes) return nullptr;
    return places->take(kMostLargeDiffs, request.caller.key_id, "requests for many tiles",
                        context.options.client_share);
  };
  return route;
}

/// `min_x,min_y,max_x,max_y`; nothing where it is not asked for.
std::optional<Eigen::AlignedBox2d> read_area(const std::map<std::string, std::string>& values) {
  const auto found = values.find("area");
  if (found == values.end()) return std::nullopt;
  std::vector<double> numbers;
  std::string_view rest = found->second;
  for (bool more = true; more;) {
    const std::size_t comma = rest.find(',');
    const auto number = maps::parse_number(rest.substr(0, comma));
    numbers.push_back(number.value_or(std::numeric_limits<double>::quiet_NaN()));
    more = comma != rest.npos;
    if (more) rest.remove_prefix(comma + 1);
  }
  // Not a number is below none.
  if (numbers.size() != 4 || !(numbers[0] <= numbers[2] && numbers[1] <= numbers[3]))
    throw field_error(ErrorCode::kInvalidRequest, "area", "'" + found->second + "'",
                      "min_x,min_y,max_x,max_y [m]");
  return Eigen::AlignedBox2d(Eigen::Vector2d(numbers[0], numbers[1]),
                             Eigen::Vector2d(numbers[2], numbers[3]));
}

HttpResponse answer_tile_list(const Context& context, const HttpRequest& request,
                              const PathParameters& path) {
  const auto values = read_query(request, {"area", "limit", "before"});
  const PageQuery page = read_page(values);
  const std::optional<Eigen::AlignedBox2d> area = read_area(values);
  const ServedVersion map = find_version(context.catalog, path);
  return json_response(tile_list_json(list_tiles(*map.package, area, page.limit, page.before)));
}

}  // namespace

void add_tile_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/tiles",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return answer_tile_list(context, request, path);
                    }});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/tiles/{level}/{x}/{y}",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return answer_tile(context, request, path);
                    }});
  routes.push_back({"GET", "/v1/maps/{map}/tiles/{level}/{x}/{y}",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return redirect_tile(context.catalog, path);
                    }});
  routes.push_back(diff_route(context));
}

}  // namespace stillmap::server
