#include "http/router.hpp"

#include "errors/api_error.hpp"

#include <set>
#include <utility>

namespace stillmap::server {
namespace {

std::vector<std::string> parts_of(std::string_view path) {
  std::vector<std::string> parts;
  while (path.starts_with('/')) {
    path.remove_prefix(1);
    const std::size_t end = path.find('/');
    parts.emplace_back(path.substr(0, end));
    path.remove_prefix(end == std::string_view::npos ? path.size() : end);
  }
  return parts;
}

/// Takes the value of a `{name}`, maybe with text behind it (`{y}.glb`), from a part of a path.
/// @return false when the part does not end so, or leaves nothing for the name.
bool take_parameter(std::string_view pattern, std::string_view part, PathParameters& parameters) {
  const std::size_t end = pattern.find('}');
  const std::string_view behind = pattern.substr(end + 1);
  if (part.size() <= behind.size() || !part.ends_with(behind)) return false;
  parameters.emplace(pattern.substr(1, end - 1), part.substr(0, part.size() - behind.size()));
  return true;
}

bool is_parameter(std::string_view pattern) {
  return pattern.starts_with('{') && pattern.find('}') > 1 && pattern.find('}') != pattern.npos;
}

bool fits(const std::vector<std::string>& pattern, const std::vector<std::string>& parts,
          PathParameters& parameters) {
  if (pattern.size() != parts.size()) return false;
  parameters.clear();
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (is_parameter(pattern[i])) {
      if (!take_parameter(pattern[i], parts[i], parameters)) return false;
    } else if (pattern[i] != parts[i]) {
      return false;
    }
  }
  return true;
}

std::string joined(const std::set<std::string>& methods) {
  std::string text;
  for (const std::string& method : methods) text += (text.empty() ? "" : ", ") + method;
  return text;
}

}  // namespace

Router::Router(std::vector<Route> routes) {
  entries_.reserve(routes.size());
  for (Route& route : routes) {
    std::vector<std::string> parts = parts_of(route.pattern);
    entries_.push_back({std::move(route), std::move(parts)});
  }
}

Router::Match Router::match(std::string_view method, std::string_view path) const {
  const std::vector<std::string> parts = parts_of(path);
  std::set<std::string> allowed;
  PathParameters parameters;
  for (const Entry& entry : entries_) {
    if (!fits(entry.parts, parts, parameters)) continue;
    if (entry.route.method == method || (method == "HEAD" && entry.route.method == "GET")) {
      return {&entry.route, std::move(parameters)};
    }
    allowed.insert(entry.route.method);
    if (entry.route.method == "GET") allowed.insert("HEAD");
  }
  const std::string where(path);
  if (allowed.empty()) throw ApiError(ErrorCode::kUnknownRoute, "nothing is served at " + where);
  throw ApiError(ErrorCode::kMethodNotAllowed, where + " takes " + joined(allowed))
      .with_header("Allow", joined(allowed));
}

std::vector<const Route*> Router::routes() const {
  std::vector<const Route*> all;
  all.reserve(entries_.size());
  for (const Entry& entry : entries_) all.push_back(&entry.route);
  return all;
}

}  // namespace stillmap::server
