#include "http/problem.hpp"

#include "json/problem_json.hpp"

namespace stillmap::server {

HttpResponse problem_response(const ApiError& error, const std::string& request_id) {
  return {.status = info_of(error.code()).http_status,
          .content_type = "application/problem+json",
          .body = problem_json(error, request_id),
          .headers = error.headers()};
}

}  // namespace stillmap::server
