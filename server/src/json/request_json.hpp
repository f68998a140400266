#pragma once

#include <nlohmann/json.hpp>

#include <cstddef>
#include <initializer_list>
#include <limits>
#include <span>
#include <string>
#include <string_view>

namespace stillmap::server {

/// Reads a request's JSON text, in time that grows as its bytes do; an empty one is no JSON.
/// @param max_values  in it, arrays and objects counted too: `[]` takes some 20 times its bytes.
/// @throws ApiError kPayloadTooLarge, kInvalidRequest for what is no JSON, is nested deeper than 8
///   or has a key twice in one object.
[[nodiscard]] nlohmann::json parse_request_json(
    std::string_view text, std::size_t max_bytes,
    std::size_t max_values = std::numeric_limits<std::size_t>::max());

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
