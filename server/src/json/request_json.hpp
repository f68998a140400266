#pragma once

#include <nlohmann/json.hpp>

#include <cstddef>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>

namespace stillmap::server {

/// Reads a request's JSON text; an empty one is no JSON.
/// @throws ApiError kPayloadTooLarge, kInvalidRequest for what is no JSON or nested deeper than 8.
[[nodiscard]] nlohmann::json parse_request_json(std::string_view text, std::size_t max_bytes);

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
