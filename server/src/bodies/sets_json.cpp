#include "bodies/sets_json.hpp"

#include "errors/api_error.hpp"
#include "json/json_values.hpp"
#include "json/request_json.hpp"
#include "pose/pose_checks.hpp"
#include "store/map_name.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace stillmap::server {
namespace {

template <std::size_t kCount>
std::array<double, kCount> read_numbers(const nlohmann::json& object, const char* key,
                                        const std::string& path,
                                        const std::array<double, kCount>& usual) {
  const auto found = object.find(key);
  if (found == object.end()) return usual;
  const bool fits = found->is_array() && found->size() == kCount &&
                    std::all_of(found->begin(), found->end(),
                                [](const nlohmann::json& each) { return each.is_number(); });
  if (!fits) refuse(path + "." + key, *found, fmt::format("{} numbers", kCount));
  return found->get<std::array<double, kCount>>();
}

MapSet::Member read_member(const nlohmann::json& member, const std::string& path) {
  if (!member.is_object()) refuse(path, member, "{map, position, quaternion}");
  require_keys(member, path, {"map", "position", "quaternion"});
  MapSet::Member result;
  const nlohmann::json map = member.value("map", nlohmann::json());
  if (map.is_string()) result.map = map.get<std::string>();
  if (!is_valid_map_name(result.map)) refuse(path + ".map", map, "the name of a map");
  result.T_set_map =
      checked_pose(read_numbers<3>(member, "position", path, {0.0, 0.0, 0.0}),
                   read_numbers<4>(member, "quaternion", path, {0.0, 0.0, 0.0, 1.0}),
                   {ErrorCode::kInvalidTransform, path + ".position", path + ".quaternion"});
  return result;
}

Json to_json(const MapSet& set) {
  Json json{{"name", set.name}, {"maps", Json::array()}};
  for (const auto& [map, T_set_map] : set.maps) {
    Json member{{"map", map}};
    member.update(to_json_pose(T_set_map));
    json["maps"].push_back(std::move(member));
  }
  return json;
}

}  // namespace

MapSet read_set_json(std::string_view text) {
  const nlohmann::json request =
      parse_request_json(text, {.max_bytes = kMostSetJson, .max_values = 12 * kMostMapsOfSet + 10});
  require_keys(request, "", {"maps"});
  const nlohmann::json maps = request.value("maps", nlohmann::json());
  if (!maps.is_array() || maps.empty() || maps.size() > kMostMapsOfSet)
    refuse("maps", maps, fmt::format("1 to {} maps", kMostMapsOfSet));
  MapSet set;
  for (const nlohmann::json& each : maps)
    set.maps.push_back(read_member(each, fmt::format("maps[{}]", set.maps.size())));
  std::sort(set.maps.begin(), set.maps.end(),
            [](const auto& a, const auto& b) { return a.map < b.map; });
  for (std::size_t i = 1; i < set.maps.size(); ++i)
    if (set.maps[i].map == set.maps[i - 1].map)
      throw field_error(ErrorCode::kInvalidRequest, "maps", "'" + set.maps[i].map + "' twice",
                        "each map once");
  return set;
}

std::string set_json(const MapSet& set) { return to_text(to_json(set)); }

std::string sets_json(const std::vector<MapSet>& sets) {
  Json json{{"sets", Json::array()}};
  for (const MapSet& set : sets) json["sets"].push_back(to_json(set));
  return to_text(json);
}

}  // namespace stillmap::server
