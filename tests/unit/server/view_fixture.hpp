#pragma once

#include <gmock/gmock.h>

#include <chrono>
#include <string>
#include <thread>

#include "service_fixture.hpp"

namespace stillmap::server {

/// All of an answer's body, wherever it comes from.
inline std::string sent(const HttpResponse& response) {
  if (!response.source) return response.body;
  std::string bytes(response.source->size(), '\0');
  response.source->read(0, bytes);
  return bytes;
}

inline std::string header(const HttpResponse& response, const std::string& name) {
  for (const auto& [each, value] : response.headers)
    if (each == name) return value;
  return {};
}

/// A service whose answers may first have to be made.
class ViewTest : public ServiceTest {
 protected:
  /// Asks until it is made.
  [[nodiscard]] HttpResponse made(const std::string& path) const {
    while (true) {
      HttpResponse response = get(path);
      if (response.status != 503 || body(response)["code"] != "BeingMade") return response;
      EXPECT_THAT(response.headers, ::testing::Contains(::testing::Pair("Retry-After", "1")));
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  [[nodiscard]] HttpResponse again(const std::string& path, const std::string& etag) const {
    HttpRequest asked = request("GET", path);
    asked.headers["if-none-match"] = etag;
    return service_->handle(asked);
  }
};

}  // namespace stillmap::server
