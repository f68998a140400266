#pragma once

#include "http/http_message.hpp"

#include <optional>
#include <string>

namespace stillmap::server {

/// SHA-256 that the client announces for its body in `Content-Digest` (RFC 9530), lower-case hex;
/// nothing without one. Other algorithms beside it are ignored.
/// @throws ApiError kInvalidRequest when it cannot be read or has no SHA-256.
[[nodiscard]] std::optional<std::string> wanted_sha256(const HttpRequest& request);

/// The header's value for a SHA-256 in hex. @throws std::invalid_argument.
[[nodiscard]] std::string content_digest_of(const std::string& sha256_hex);

}  // namespace stillmap::server
