#pragma once

#include <string>
#include <string_view>

namespace stillmap::server {

/// @return 16 hex digits that no other request has: unique within a process, and in practice over
/// all.
[[nodiscard]] std::string new_request_id();
/// @return the client's own id when it is 1 to 64 of `[A-Za-z0-9._-]`, else `own`.
[[nodiscard]] std::string request_id_from(std::string_view client_id, const std::string& own);

/// A client's text for a log line: control characters, which could forge lines, become '?'.
[[nodiscard]] std::string printable(std::string_view text);

}  // namespace stillmap::server
