#pragma once

#include <chrono>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {

/// A request as the handlers see it: no HTTP library, no socket.
struct HttpRequest {
  std::string method;
  /// Percent-decoded, without the query.
  std::string path;
  /// Decoded; a name may come twice.
  std::vector<std::pair<std::string, std::string>> query;
  /// Names in lower case, the first value of each.
  std::map<std::string, std::string> headers;
  std::string body;
  std::string request_id;
  std::chrono::steady_clock::time_point received = std::chrono::steady_clock::now();

  /// @return empty when there is no such header. @param name  in lower case.
  [[nodiscard]] std::string header(const std::string& name) const {
    const auto found = headers.find(name);
    return found == headers.end() ? std::string{} : found->second;
  }
};

struct HttpResponse {
  int status = 200;
  std::string content_type;
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers;
};

}  // namespace stillmap::server
