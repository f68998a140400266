#pragma once

#include "errors/api_error.hpp"
#include "http/http_message.hpp"

#include <string>

namespace stillmap::server {

/// An error as `application/problem+json`.
[[nodiscard]] HttpResponse problem_response(const ApiError& error, const std::string& request_id);

}  // namespace stillmap::server
