#pragma once

#include <string>
#include <string_view>

namespace stillmap::maps {

/// SHA-256 as lower-case hex.
[[nodiscard]] std::string sha256_of(std::string_view bytes);

}  // namespace stillmap::maps
