#pragma once

#include <string>
#include <string_view>

namespace stillmap::server {

/// The client's own id when it is 1 to 64 of `[A-Za-z0-9._-]`, else a fresh one of 16 hex digits.
[[nodiscard]] std::string request_id_from(std::string_view client_id);

/// A client's text for a log line: control characters, which could forge lines, become '?'.
[[nodiscard]] std::string printable(std::string_view text);

}  // namespace stillmap::server
