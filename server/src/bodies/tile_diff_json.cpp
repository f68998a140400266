#include "bodies/tile_diff_json.hpp"

#include "errors/api_error.hpp"
#include "json/json_values.hpp"
#include "json/request_json.hpp"

#include <fmt/format.h>

#include <cmath>

namespace stillmap::server {
namespace {

/// As far as a place may be from the origin in any request [m].
constexpr double kMaxCentreM = 1e8;

/// Twice what the ids take, so that who sends too many of them is told so.
constexpr std::size_t kMaxDiffValues = 2 * kMaxCachedIds;

std::vector<std::string> read_ids(const nlohmann::json& request) {
  std::vector<std::string> ids;
  const auto found = request.find("cached_ids");
  if (found == request.end()) return ids;
  if (!found->is_array()) refuse("cached_ids", *found, "an array");
  if (found->size() > kMaxCachedIds) {
    throw field_error(ErrorCode::kPayloadTooLarge, "cached_ids",
                      fmt::format("{} ids", found->size()),
                      fmt::format("at most {}", kMaxCachedIds));
  }
  for (const nlohmann::json& id : *found) {
    if (!id.is_string()) refuse("cached_ids", id, "text");
    ids.push_back(id.get<std::string>());
  }
  return ids;
}

std::uint32_t read_level(const nlohmann::json& request) {
  const auto found = request.find("level");
  if (found == request.end()) return 0;
  const std::string expected = fmt::format("an integer in [0, {}]", kMaxDiffLevel);
  if (!found->is_number_unsigned()) refuse("level", *found, expected);
  const auto level = found->get<std::uint64_t>();
  if (level > kMaxDiffLevel) refuse("level", *found, expected);
  return static_cast<std::uint32_t>(level);
}

/// Nothing reads as null, which is refused like any other value.
nlohmann::json value_of(const nlohmann::json& request, const char* key) {
  return request.value(key, nlohmann::json());
}

Eigen::Vector2d read_center(const nlohmann::json& request) {
  const nlohmann::json found = value_of(request, "center");
  const std::string expected = fmt::format("[x, y], each within {} m", kMaxCentreM);
  if (!found.is_array() || found.size() != 2 || !found[0].is_number() || !found[1].is_number()) {
    refuse("center", found, expected);
  }
  Eigen::Vector2d centre(found[0].get<double>(), found[1].get<double>());
  if (!(centre.cwiseAbs().maxCoeff() <= kMaxCentreM)) refuse("center", found, expected);
  return centre;
}

double read_radius_m(const nlohmann::json& request, std::uint32_t level) {
  const nlohmann::json found = value_of(request, "radius_m");
  const double most_m = kMaxDiffWidths * std::ldexp(maps::kTileSizeM, static_cast<int>(level));
  const double radius_m = found.is_number() ? found.get<double>() : 0.0;
  if (!(radius_m > 0.0 && radius_m <= most_m)) {
    refuse("radius_m", found, fmt::format("above 0 and up to {} m at level {}", most_m, level));
  }
  return radius_m;
}

}  // namespace

TileDiffRequest read_tile_diff_json(std::string_view text, const ServerOptions& options) {
  const nlohmann::json request =
      parse_request_json(text, {.max_bytes = options.max_json_bytes, .max_values = kMaxDiffValues});
  require_keys(request, "", {"center", "radius_m", "level", "cached_ids"});
  TileDiffRequest result;
  result.centre_map = read_center(request);
  result.level = read_level(request);
  result.radius_m = read_radius_m(request, result.level);
  result.cached_ids = read_ids(request);
  return result;
}

std::string tile_diff_json(const TileDiff& diff) {
  Json json;
  json["version"] = diff.version;
  json["add"] = Json::array();
  for (const TileDiff::Added& each : diff.add) {
    json["add"].push_back({{"id", each.id},
                           {"level", each.tile.id.level},
                           {"x", each.tile.id.x},
                           {"y", each.tile.id.y},
                           {"points", each.tile.points},
                           {"corner", to_json_array(each.corner_map)},
                           {"url", each.url}});
  }
  json["remove"] = diff.remove;
  return to_text(json);
}

}  // namespace stillmap::server
