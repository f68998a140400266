#pragma once

#include "errors/api_error.hpp"

#include <Eigen/Core>

#include <nlohmann/json.hpp>

#include <cstddef>
#include <functional>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// Bounds of a request's JSON. They hold while it is read.
struct JsonBounds {
  std::size_t max_bytes;
  /// In it, arrays and objects counted too: an empty object takes some 30 times its bytes in
  /// memory.
  std::size_t max_values;
  /// Called every few thousand values. It throws when nobody waits for the answer any more.
  std::function<void()> require_wanted = {};
};

/// Reads a request's JSON text, in time that grows as its bytes do; an empty one is no JSON.
/// @throws ApiError kPayloadTooLarge, kInvalidRequest for what is no JSON, is nested deeper than 8
///   or has a key twice in one object; what `JsonBounds::require_wanted` throws.
[[nodiscard]] nlohmann::json parse_request_json(std::string_view text, const JsonBounds& bounds);

/// A list of points, read without a JSON value for each number.
struct JsonPoints {
  /// Without those at (0, 0, 0), which mean "no return" as in the other formats.
  std::vector<Eigen::Vector3f> positions;
  /// Set when it is no list of points, or has too many. The text behind is read on all the same.
  std::optional<ApiError> error;
};

/// Lists `points` stand beside the JSON, where each is the index of its list.
struct JsonWithPoints {
  nlohmann::json json;
  std::vector<JsonPoints> lists;
};

/// As `parse_request_json`, for requests that have scans in them.
/// @param depth  of the objects whose key `points` is a list of points: 1 = the request itself.
/// @param max_points  of one list.
[[nodiscard]] JsonWithPoints parse_json_with_points(std::string_view text, const JsonBounds& bounds,
                                                    std::size_t depth, std::size_t max_points);

/// @param path  of what was found, as "prior.position". @throws ApiError kInvalidRequest.
[[noreturn]] void refuse(const std::string& path, const nlohmann::json& found,
                         const std::string& expected);

/// @param path  of the object; empty for the whole.
/// @throws ApiError kInvalidRequest when it is none, kUnknownParameter for any other key.
void require_keys(const nlohmann::json& object, const std::string& path,
                  std::span<const std::string_view> known);
void require_keys(const nlohmann::json& object, const std::string& path,
                  std::initializer_list<std::string_view> known);

}  // namespace stillmap::server
