#include "handlers/set_maps.hpp"

#include "errors/api_error.hpp"
#include "errors/refusal_codes.hpp"
#include "handlers/session_scan.hpp"
#include "security/map_limits.hpp"

#include <stillmap/maps/geodesy.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

namespace stillmap::server {
namespace {

/// Every map of the caller's that knows its place on the Earth, in the frame of the first one.
MapSet all_on_earth(const MapCatalog& catalog, const Caller& caller) {
  MapSet set;
  std::optional<maps::GeodeticOrigin> first;
  bool is_another_there = false;
  for (const ServedVersion& map : catalog.active()) {
    if (!map.package) continue;
    if (!may_use_map(caller, map.map)) {
      is_another_there = true;
      continue;
    }
    const auto& origin = map.package->manifest().geodetic_origin;
    if (!origin) continue;
    if (!first) first = origin;
    set.maps.push_back({.map = map.map, .T_set_map = maps::T_enu_enu(*first, *origin)});
  }
  if (set.maps.empty() && is_another_there)
    throw ApiError(ErrorCode::kForbidden,
                   "the API key is for no map with a place on the Earth: name a map, or a set and "
                   "a prior");
  if (set.maps.empty())
    throw field_error(ErrorCode::kNoGeodeticOrigin, "gnss", "maps without geodetic_origin",
                      "a map with a place on the Earth (build --geo-origin), or a set and a prior");
  return set;
}

/// Nothing when it cannot be asked, and `why` then.
std::optional<SetMap> ready_map(const Context& context, const MapSet::Member& member,
                                const std::string& vehicle, std::optional<ApiError>& why) {
  try {
    ServedVersion map = context.catalog.ready(member.map, std::nullopt, vehicle);
    const bool came_with_rollout = is_rolled_out(context.catalog, map);
    return SetMap{
        .map = std::move(map), .T_set_map = member.T_set_map, .is_rolled_out = came_with_rollout};
  } catch (const ApiError& error) {
    why = error;
  } catch (const StoreRefusal& refusal) {
    why = ApiError(code_of(refusal.reason()), refusal.what());
  }
  return std::nullopt;
}

}  // namespace

std::vector<MapSet> seen_sets(const Context& context, const Caller& caller) {
  std::vector<MapSet> sets = context.catalog.sets();
  for (MapSet& set : sets)
    std::erase_if(set.maps, [&](const auto& member) { return !may_use_map(caller, member.map); });
  std::erase_if(sets, [](const MapSet& set) { return set.maps.empty(); });
  return sets;
}

MapSet wanted_set(const Context& context, const Caller& caller, const std::string& name,
                  bool may_be_anywhere) {
  std::vector<MapSet> sets = seen_sets(context, caller);
  if (!name.empty()) {
    const auto found = std::ranges::find(sets, name, &MapSet::name);
    if (found != sets.end()) return std::move(*found);
    throw ApiError(ErrorCode::kUnknownSet, "there is no set '" + name + "' of maps");
  }
  if (sets.size() == 1) return std::move(sets.front());
  if (may_be_anywhere) return all_on_earth(context.catalog, caller);
  std::vector<std::string> names;
  for (const MapSet& set : sets) names.push_back(set.name);
  throw field_error(ErrorCode::kInvalidRequest, "set", "nothing",
                    names.empty() ? "the name of a set, and there is none: make one with PUT "
                                    "/v1/sets/{set}, or name a map in the path"
                                  : fmt::format("one of {}", fmt::join(names, ", ")));
}

SetOfRequest maps_of(const Context& context, const MapSet& set, const std::string& vehicle) {
  SetOfRequest found{.name = set.name, .maps = {}, .loading = {}, .unusable = {}};
  std::optional<ApiError> first_problem;
  for (const MapSet::Member& member : set.maps) {
    std::optional<ApiError> why;
    if (auto map = ready_map(context, member, vehicle, why)) found.maps.push_back(*std::move(map));
    if (!why) continue;
    (why->code() == ErrorCode::kMapLoading ? found.loading : found.unusable) = why;
    if (!first_problem) first_problem = why;
  }
  if (found.maps.empty()) throw ApiError(first_problem.value());
  return found;
}

int units_in(const MapSet& set, WorkKind kind) {
  if (kind == WorkKind::kNearPrior) return 1;
  return static_cast<int>(std::clamp<std::size_t>(set.maps.size(), 1, kMostCandidates));
}

std::string_view name_of(const PlaceInSet& place) {
  if (place.prior) return "prior";
  return place.gnss ? "gnss" : "nothing";
}

void set_map(PoseAnswer& answer, const SetOfRequest& set, const ServedVersion& map) {
  answer.map_name = map.map;
  answer.map_version = map.version;
  answer.map_digest = map.package->digest();
  answer.set = set.name;
  for (const SetMap& each : set.maps)
    if (each.map.map == map.map) answer.T_set_map = each.T_set_map;
}

}  // namespace stillmap::server
