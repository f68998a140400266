#include "context.hpp"

#include "errors/api_error.hpp"
#include "http/header_text.hpp"

#include "store/map_name.hpp"

#include <utility>

namespace stillmap::server {

void check_name(const PathParameters& path, const std::string& part) {
  const std::string& name = path.find(part)->second;
  if (is_valid_map_name(name)) return;
  throw field_error(ErrorCode::kInvalidRequest, part, "'" + name + "'",
                    "[a-z0-9][a-z0-9._-]{0,62}");
}

void require_json(const HttpRequest& request) {
  const std::string type = media_type(request.header("content-type"));
  if (type == "application/json") return;
  throw field_error(ErrorCode::kUnsupportedMediaType, "Content-Type", "'" + type + "'",
                    "application/json");
}

void require_json_if_any(const HttpRequest& request) {
  // Before the body is read, its length tells whether there is one.
  const std::string length = request.header("content-length");
  if (!request.body.empty() || (!length.empty() && length != "0")) require_json(request);
}

bool is_known_to_client(const std::string& if_none_match, const std::string& etag) {
  return if_none_match == "*" || if_none_match.find(etag) != std::string::npos;
}

bool flag_in_query(const HttpRequest& request, std::string_view flag) {
  bool wanted = false;
  for (const auto& [name, value] : request.query) {
    if (name != flag) {
      throw field_error(ErrorCode::kUnknownParameter, name, "a parameter", std::string(flag));
    }
    if (value != "true" && value != "false") {
      throw field_error(ErrorCode::kInvalidRequest, name, "'" + value + "'", "true or false");
    }
    wanted = value == "true";
  }
  return wanted;
}

std::string etag_of(const StoredMap& map) { return "\"" + std::to_string(map.revision) + "\""; }

std::optional<std::string_view> version_in(const PathParameters& path) {
  const auto version = path.find("version");
  if (version == path.end()) return std::nullopt;
  return version->second;
}

ServedVersion find_version(MapCatalog& catalog, const PathParameters& path) {
  const std::optional<std::string_view> version = version_in(path);
  return version ? catalog.find(path.at("map"), *version)
                 : std::as_const(catalog).find(path.at("map"));
}

}  // namespace stillmap::server
