#pragma once

#include "errors/api_error.hpp"

#include <string>

namespace stillmap::server {

/// The body of `application/problem+json` (RFC 9457).
[[nodiscard]] std::string problem_json(const ApiError& error, const std::string& request_id);

}  // namespace stillmap::server
