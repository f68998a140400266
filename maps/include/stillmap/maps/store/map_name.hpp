#pragma once

#include <string_view>

namespace stillmap::maps {

/// Whether a map or a version may be called so: `[a-z0-9][a-z0-9._-]{0,62}`, safe in URLs and on
/// command lines. No folder is ever named after it.
[[nodiscard]] bool is_valid_map_name(std::string_view name);

}  // namespace stillmap::maps
