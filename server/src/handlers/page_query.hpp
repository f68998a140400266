#pragma once

#include "errors/api_error.hpp"
#include "handlers/context.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

/// Parameters of a query, each at most once. @throws ApiError kUnknownParameter, kInvalidRequest.
[[nodiscard]] inline std::map<std::string, std::string> read_query(
    const HttpRequest& request, std::initializer_list<std::string_view> known) {
  std::map<std::string, std::string> values;
  std::string names;
  for (const std::string_view name : known)
    names += (names.empty() ? "" : ", ") + std::string(name);
  for (const auto& [name, value] : request.query) {
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw field_error(ErrorCode::kUnknownParameter, name, "a parameter", names);
    if (!values.emplace(name, value).second)
      throw field_error(ErrorCode::kInvalidRequest, name, "it twice", "it once");
  }
  return values;
}

/// Which part of a list, newest first.
struct PageQuery {
  std::size_t limit = 20;
  std::optional<std::int64_t> before{};
};

/// Reads `limit` (1 to 1000) and `before`. @throws ApiError kInvalidRequest.
[[nodiscard]] inline PageQuery read_page(const std::map<std::string, std::string>& values) {
  PageQuery page;
  if (const auto limit = values.find("limit"); limit != values.end()) {
    const std::optional<std::int64_t> count = id_in(limit->second);
    if (!count || *count > 1000)
      throw field_error(ErrorCode::kInvalidRequest, "limit", "'" + limit->second + "'",
                        "1 to 1000");
    page.limit = static_cast<std::size_t>(*count);
  }
  if (const auto before = values.find("before"); before != values.end()) {
    page.before = id_in(before->second);
    if (!page.before)
      throw field_error(ErrorCode::kInvalidRequest, "before", "'" + before->second + "'",
                        "what next was");
  }
  return page;
}

}  // namespace stillmap::server
