#include "bodies/difference_json.hpp"

#include "json/json_values.hpp"

#include <fmt/format.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <set>
#include <utility>

namespace stillmap::server {
namespace {

using maps::DifferenceSide;

Json json_of(const maps::DifferenceCounts& counts) {
  // In the order of PointKind.
  constexpr std::array kNames = {"measured", "ground", "projected", "filled"};
  Json kinds;
  for (std::size_t kind = 0; kind < kNames.size(); ++kind) kinds[kNames[kind]] = counts.kinds[kind];
  return {{"points", counts.points},
          {"kinds", kinds},
          {"area_m2", counts.area_m2},
          {"seen_free", counts.seen_free}};
}

Json json_of(const ComparedVersions& pair, const maps::DifferenceTile* tile) {
  if (tile == nullptr) return {};
  Json json = json_of(tile->counts);
  json["min"] = tile->entry.min;
  json["max"] = tile->entry.max;
  const char* side = tile->side == DifferenceSide::kVersion ? "version" : "other";
  json["url"] = fmt::format("/v1/maps/{}/versions/{}/difference/{}/{}/{}/{}.glb?tolerance_m={}",
                            pair.version.map, pair.version.version, pair.other.version, side,
                            tile->entry.id.x, tile->entry.id.y, pair.tolerance_m);
  return json;
}

}  // namespace

std::string difference_json(const ComparedVersions& pair, const maps::MapDifference& difference) {
  std::set<std::pair<std::int32_t, std::int32_t>> places;
  for (const maps::DifferenceTile& tile : difference.tiles())
    places.emplace(tile.entry.id.x, tile.entry.id.y);
  Json tiles = Json::array();
  for (const auto& [x, y] : places) {
    tiles.push_back(
        {{"x", x},
         {"y", y},
         {"only_in_version", json_of(pair, difference.find(DifferenceSide::kVersion, x, y))},
         {"only_in_other", json_of(pair, difference.find(DifferenceSide::kOther, x, y))}});
  }
  return to_text(Json{{"state", "ready"},
                      {"map", pair.version.map},
                      {"version", pair.version.version},
                      {"other", pair.other.version},
                      {"tolerance_m", pair.tolerance_m},
                      {"origin", to_json_array(pair.version.package->manifest().origin)},
                      {"only_in_version", json_of(difference.total(DifferenceSide::kVersion))},
                      {"only_in_other", json_of(difference.total(DifferenceSide::kOther))},
                      {"tiles", std::move(tiles)}});
}

std::string difference_progress_json(double progress) {
  return to_text(Json{{"state", "making"}, {"progress", progress}});
}

}  // namespace stillmap::server
