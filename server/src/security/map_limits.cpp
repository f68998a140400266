#include "security/map_limits.hpp"

#include "errors/api_error.hpp"
#include "store/ids_and_times.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "store/key_table.hpp"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>

namespace stillmap::server {

bool may_use_map(const Caller& caller, std::string_view map) {
  return caller.maps.empty() ||
         std::any_of(caller.maps.begin(), caller.maps.end(),
                     [&](const std::string& pattern) { return matches_pattern(map, pattern); });
}

void require_map(const Caller& caller, std::string_view map) {
  if (may_use_map(caller, map)) return;
  throw field_error(ErrorCode::kForbidden, "Authorization",
                    fmt::format("a key for the maps {}", fmt::join(caller.maps, ", ")),
                    fmt::format("a key that may be used for map '{}'", map));
}

void require_maps_of_path(const HttpRequest& request, const Router::Match& match,
                          PackageStore& store) {
  const Caller& caller = request.caller;
  if (caller.maps.empty() || is_open(match.route->access)) return;
  if (const auto map = match.parameters.find("map"); map != match.parameters.end())
    return require_map(caller, map->second);
  if (const auto job = match.parameters.find("job"); job != match.parameters.end()) {
    const std::optional<std::int64_t> id = id_in(job->second);
    // One that is not there is left to the handler, whose answer must be the same.
    if (id && !may_use_map(caller, store.jobs().job(*id).map))
      throw ApiError(ErrorCode::kUnknownJob, fmt::format("there is no job {}", *id));
    return;
  }
  if (match.route->limits_maps || match.parameters.contains("session")) return;
  throw field_error(ErrorCode::kForbidden, "Authorization",
                    fmt::format("a key for the maps {}", fmt::join(caller.maps, ", ")),
                    "a key for all maps");
}

}  // namespace stillmap::server
