#include "json/keys_request_json.hpp"

#include "json/request_json.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

using RequestJson = nlohmann::json;

/// A century, as on the command line.
constexpr std::int64_t kMostDays = 36'500;

maps::KeyScopes read_scopes(const RequestJson& request) {
  const RequestJson names = request.value("scopes", RequestJson());
  if (!names.is_array() || names.empty())
    refuse("scopes", names, "some of read, localize, write, admin");
  maps::KeyScopes scopes;
  for (const RequestJson& name : names) {
    const auto& all = maps::all_key_scopes();
    const auto found = std::find_if(all.begin(), all.end(), [&](const maps::KeyScope scope) {
      return name.is_string() && name.get<std::string>() == maps::name_of(scope);
    });
    if (found == all.end()) refuse("scopes", name, "read, localize, write or admin");
    scopes.add(*found);
  }
  return scopes;
}

}  // namespace

KeyRequest read_key_request(std::string_view text) {
  const RequestJson request =
      parse_request_json(text, {.max_bytes = kMostKeyJson, .max_values = 100});
  require_keys(request, "", {"name", "scopes", "expires_days"});
  KeyRequest result;
  const RequestJson name = request.value("name", RequestJson());
  if (name.is_string()) result.name = name.get<std::string>();
  const bool control = std::any_of(result.name.begin(), result.name.end(), [](char byte) {
    return static_cast<unsigned char>(byte) < 0x20 || byte == 0x7f;
  });
  if (result.name.empty() || result.name.size() > 100 || control)
    refuse("name", name, "text of 1 to 100 bytes without control characters");
  result.scopes = read_scopes(request);
  if (const auto days = request.find("expires_days"); days != request.end()) {
    if (!days->is_number_integer() || *days < 1 || *days > kMostDays)
      refuse("expires_days", *days, "1 to 36500");
    result.expires_days = days->get<std::int64_t>();
  }
  return result;
}

}  // namespace stillmap::server
