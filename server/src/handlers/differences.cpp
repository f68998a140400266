#include "bodies/difference_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"
#include "handlers/page_query.hpp"
#include "handlers/tile_answer.hpp"
#include "handlers/tile_path.hpp"

#include <fmt/format.h>

#include <charconv>
#include <memory>
#include <string>
#include <utility>

namespace stillmap::server {
namespace {

using maps::MapDifference;

/// To the millimetre, so that equal ones are equal.
double tolerance_in(const HttpRequest& request, double usual_m) {
  const auto values = read_query(request, {"tolerance_m"});
  const auto given = values.find("tolerance_m");
  double tolerance_m = usual_m;
  if (given != values.end()) {
    const std::string& text = given->second;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), tolerance_m);
    const bool is_number = error == std::errc{} && end == text.data() + text.size();
    if (!is_number || !(tolerance_m >= MapDifference::kSmallestToleranceM &&
                        tolerance_m <= MapDifference::kLargestToleranceM)) {
      throw field_error(ErrorCode::kInvalidRequest, "tolerance_m", "'" + text + "'",
                        fmt::format("{} to {}", MapDifference::kSmallestToleranceM,
                                    MapDifference::kLargestToleranceM));
    }
  }
  return MapDifference::tolerance_mm(tolerance_m) / 1000.0;
}

ComparedVersions read_pair(const Context& context, const HttpRequest& request,
                           const PathParameters& path) {
  ComparedVersions pair;
  pair.version = context.catalog.find(path.at("map"), path.at("version"));
  pair.other = context.catalog.find(path.at("map"), path.at("other"));
  pair.tolerance_m = tolerance_in(
      request, MapDifference::usual_tolerance_m(*pair.version.package, *pair.other.package));
  return pair;
}

/// Of versions in one frame alone: asks for it when it is not there.
DifferenceState difference_of(const Context& context, const ComparedVersions& pair) {
  if (auto found = context.views.open_difference(pair)) return {std::move(found), 1.0};
  if (!context.catalog.in_one_frame(pair.version, pair.other)) {
    throw ApiError(ErrorCode::kOtherFrame,
                   fmt::format("version '{}' of map '{}' is not known to be in the frame of '{}'",
                               pair.other.version, pair.other.map, pair.version.version));
  }
  return context.views.difference(pair);
}

std::string difference_etag(const ComparedVersions& pair, const std::string& what) {
  return fmt::format("\"{}-{}-{}-{}\"", pair.version.package->digest().substr(0, 16),
                     pair.other.package->digest().substr(0, 16),
                     MapDifference::tolerance_mm(pair.tolerance_m), what);
}

HttpResponse get_difference(const Context& context, const HttpRequest& request,
                            const PathParameters& path) {
  const ComparedVersions pair = read_pair(context, request, path);
  const DifferenceState state = difference_of(context, pair);
  if (!state.ready) {
    HttpResponse response = json_response(difference_progress_json(state.progress), 202);
    response.headers = {{"Retry-After", "1"}, {"Cache-Control", "no-store"}};
    return response;
  }
  const std::string etag = difference_etag(pair, "difference-1");
  HttpResponse response = json_response({});
  response.headers = {{"ETag", etag}, {"Cache-Control", "no-cache"}};
  if (is_known_to_client(request.header("if-none-match"), etag)) {
    response.status = 304;
  } else {
    response.body = difference_json(pair, *state.ready);
  }
  return response;
}

maps::DifferenceSide side_in(const PathParameters& path) {
  const std::string& side = path.at("side");
  if (side == "version") return maps::DifferenceSide::kVersion;
  if (side == "other") return maps::DifferenceSide::kOther;
  throw ApiError(ErrorCode::kUnknownTile,
                 "side: found '" + side + "', expected 'version' or 'other'");
}

HttpResponse get_tile(const Context& context, const HttpRequest& request,
                      const PathParameters& path) {
  const auto side = side_in(path);
  const auto x = read_coordinate<std::int32_t>(path, "x");
  const auto y = read_coordinate<std::int32_t>(path, "y");
  const ComparedVersions pair = read_pair(context, request, path);
  const DifferenceState state = difference_of(context, pair);
  if (!state.ready) {
    throw ApiError(ErrorCode::kBeingMade, "the difference is being made")
        .with_header("Retry-After", "1");
  }
  const maps::DifferenceTile* tile = state.ready->find(side, x, y);
  if (tile == nullptr)
    throw ApiError(ErrorCode::kUnknownTile, "the versions do not differ at " + request.path);
  const std::string etag =
      difference_etag(pair, fmt::format("{}-{}-{}-glb-2", path.at("side"), x, y));
  return immutable_answer(request, etag, [&](HttpResponse& response) {
    fill_with_glb(response, tile->entry,
                  context.views.difference_points(pair, *state.ready, *tile));
  });
}

}  // namespace

void add_difference_routes(std::vector<Route>& routes, const Context& context) {
  const std::string base = "/v1/maps/{map}/versions/{version}/difference/{other}";
  routes.push_back(
      {"GET", base, [&context](const HttpRequest& request, const PathParameters& path) {
         return get_difference(context, request, path);
       }});
  routes.push_back({"GET", base + "/{side}/{x}/{y}.glb",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return get_tile(context, request, path);
                    }});
}

}  // namespace stillmap::server
