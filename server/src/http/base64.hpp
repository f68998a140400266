#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

/// As RFC 4648, section 4, padded, in one line.
[[nodiscard]] std::string to_base64(std::string_view bytes);
/// Nothing for what `to_base64` does not write: blanks, no padding, bits behind the last byte.
[[nodiscard]] std::optional<std::string> from_base64(std::string_view text);

}  // namespace stillmap::server
