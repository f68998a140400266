#include "bodies/keys_request_json.hpp"

#include "json/request_json.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

using RequestJson = nlohmann::json;

/// A century, as on the command line.
constexpr std::int64_t kMostDays = 36'500;

KeyScopes read_scopes(const RequestJson& request) {
  const RequestJson names = request.value("scopes", RequestJson());
  if (!names.is_array() || names.empty())
    refuse("scopes", names, "some of read, localize, write, admin");
  KeyScopes scopes;
  for (const RequestJson& name : names) {
    const auto& all = all_key_scopes();
    const auto found = std::find_if(all.begin(), all.end(), [&](const KeyScope scope) {
      return name.is_string() && name.get<std::string>() == name_of(scope);
    });
    if (found == all.end()) refuse("scopes", name, "read, localize, write or admin");
    scopes.add(*found);
  }
  return scopes;
}

std::vector<std::string> read_maps(const RequestJson& request, KeyScopes scopes) {
  std::vector<std::string> patterns;
  const auto maps = request.find("maps");
  if (maps == request.end()) return patterns;
  if (!maps->is_array() || maps->empty() || maps->size() > kMostMapPatterns)
    refuse("maps", *maps,
           "1 to " + std::to_string(kMostMapPatterns) + " patterns; leave it out for all maps");
  if (scopes.has(KeyScope::kAdmin))
    refuse("maps", *maps,
           "no maps beside the scope admin, which makes keys for any map and reads the audit log "
           "of all: leave one of them out");
  for (const RequestJson& map : *maps) {
    patterns.push_back(map.is_string() ? map.get<std::string>() : std::string{});
    if (!is_map_pattern(patterns.back())) refuse("maps", map, "1 to 63 of [a-z0-9._-] and *");
  }
  return patterns;
}

}  // namespace

KeyRequest read_key_request(std::string_view text) {
  const RequestJson request =
      parse_request_json(text, {.max_bytes = kMostKeyJson, .max_values = 200});
  require_keys(request, "", {"name", "scopes", "expires_days", "maps"});
  KeyRequest result;
  const RequestJson name = request.value("name", RequestJson());
  if (name.is_string()) result.name = name.get<std::string>();
  const bool control = std::any_of(result.name.begin(), result.name.end(), [](char byte) {
    return static_cast<unsigned char>(byte) < 0x20 || byte == 0x7f;
  });
  if (result.name.empty() || result.name.size() > 100 || control)
    refuse("name", name, "text of 1 to 100 bytes without control characters");
  result.scopes = read_scopes(request);
  result.maps = read_maps(request, result.scopes);
  if (const auto days = request.find("expires_days"); days != request.end()) {
    if (!days->is_number_integer() || *days < 1 || *days > kMostDays)
      refuse("expires_days", *days, "1 to 36500");
    result.expires_days = days->get<std::int64_t>();
  }
  return result;
}

}  // namespace stillmap::server
