#pragma once

#include "errors/error_codes.hpp"

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {

/// One thing that is wrong with a request: where, what stood there and what was expected.
struct FieldError {
  std::string path;
  std::string found;
  std::string expected;
};

/// A request that is refused. Thrown by what reads and answers requests, caught once in `Service`.
class ApiError : public std::runtime_error {
 public:
  ApiError(ErrorCode code, const std::string& detail, std::vector<FieldError> errors = {})
      : std::runtime_error(detail), code_(code), errors_(std::move(errors)) {}

  /// Adds a header to the answer, such as Allow or Retry-After.
  ApiError&& with_header(std::string name, std::string value) && {
    headers_.emplace_back(std::move(name), std::move(value));
    return std::move(*this);
  }

  [[nodiscard]] ErrorCode code() const { return code_; }
  [[nodiscard]] const std::vector<FieldError>& errors() const { return errors_; }
  [[nodiscard]] const std::vector<std::pair<std::string, std::string>>& headers() const {
    return headers_;
  }

 private:
  ErrorCode code_;
  std::vector<FieldError> errors_;
  std::vector<std::pair<std::string, std::string>> headers_;
};

/// "PATH: found FOUND, expected EXPECTED", as detail and in errors[].
[[nodiscard]] inline ApiError field_error(ErrorCode code, const std::string& path,
                                          const std::string& found, const std::string& expected) {
  return {code, path + ": found " + found + ", expected " + expected, {{path, found, expected}}};
}

}  // namespace stillmap::server
