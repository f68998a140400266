#include "json/request_json.hpp"

#include "errors/api_error.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace stillmap::server {
namespace {

using RequestJson = nlohmann::json;

/// Deepest nesting of any request is 3.
constexpr int kMaxDepth = 8;

/// Each value has one of these.
bool begins_value(RequestJson::parse_event_t event) {
  return event == RequestJson::parse_event_t::value ||
         event == RequestJson::parse_event_t::array_start ||
         event == RequestJson::parse_event_t::object_start;
}

}  // namespace

RequestJson parse_request_json(std::string_view text, std::size_t max_bytes,
                               std::size_t max_values) {
  if (text.size() > max_bytes) {
    throw field_error(ErrorCode::kPayloadTooLarge, "JSON", fmt::format("{} bytes", text.size()),
                      fmt::format("at most {}", max_bytes));
  }
  std::size_t values = 0;
  const auto bounded = [&](int depth, RequestJson::parse_event_t event, const RequestJson&) {
    if (depth > kMaxDepth)
      throw field_error(ErrorCode::kInvalidRequest, "JSON", "deep nesting", "at most 8");
    if (begins_value(event) && ++values > max_values)
      throw field_error(ErrorCode::kPayloadTooLarge, "JSON", "more values",
                        fmt::format("at most {}", max_values));
    return true;
  };
  try {
    return RequestJson::parse(text, bounded);
  } catch (const RequestJson::exception& error) {
    // Its message is "[json.exception...] parse error at line 1, column 8: ...".
    throw ApiError(ErrorCode::kInvalidRequest, std::string("JSON: ") + error.what());
  }
}

void refuse(const std::string& path, const RequestJson& found, const std::string& expected) {
  std::string text = found.dump(-1, ' ', true, RequestJson::error_handler_t::replace);
  if (text.size() > 80) text = text.substr(0, 80) + "...";
  throw field_error(ErrorCode::kInvalidRequest, path, text, expected);
}

void require_keys(const RequestJson& object, const std::string& path,
                  std::span<const std::string_view> known) {
  if (!object.is_object()) refuse(path.empty() ? "JSON" : path, object, "an object");
  std::string names;
  for (const std::string_view name : known)
    names += (names.empty() ? "" : ", ") + std::string(name);
  for (const auto& item : object.items()) {
    if (std::find(known.begin(), known.end(), item.key()) != known.end()) continue;
    throw field_error(ErrorCode::kUnknownParameter,
                      path.empty() ? item.key() : path + "." + item.key(), "an unknown key", names);
  }
}

void require_keys(const RequestJson& object, const std::string& path,
                  std::initializer_list<std::string_view> known) {
  require_keys(object, path, std::span(known.begin(), known.size()));
}

}  // namespace stillmap::server
