#pragma once

#include "store/key_table.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// Bytes of a request for a key.
inline constexpr std::size_t kMostKeyJson = 4096;

/// What a key is made of: `name`, `scopes [...]`, `expires_days?`, `maps? [...]`.
struct KeyRequest {
  std::string name;
  KeyScopes scopes;
  std::optional<std::int64_t> expires_days;
  std::vector<std::string> maps;
};
/// @throws ApiError with the path of what is wrong; unknown keys are refused.
[[nodiscard]] KeyRequest read_key_request(std::string_view text);

}  // namespace stillmap::server
