#pragma once

#include <string>
#include <string_view>

namespace stillmap::server {

/// Whether a map or a version may be called so: `[a-z0-9][a-z0-9._-]{0,62}`, safe in URLs and on
/// command lines. No folder is ever named after it.
[[nodiscard]] bool is_valid_map_name(std::string_view name);

/// The valid name that is nearest to a text: capitals made small, other letters made `-`, cut to
/// 63; `map` where nothing is left. "My Yard" -> "my-yard".
[[nodiscard]] std::string map_name_of(std::string_view text);

}  // namespace stillmap::server
