#pragma once

#include "http_message.hpp"

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// Values of the `{name}` parts of a route, by name.
using PathParameters = std::map<std::string, std::string, std::less<>>;
using Handler = std::function<HttpResponse(const HttpRequest&, const PathParameters&)>;

struct Route {
  std::string method;
  /// Such as `/v1/maps/{map}/localize`; a `{name}` stands for one non-empty part.
  std::string pattern;
  Handler handler;
};

/// The table of routes. Immutable, safe from several threads.
class Router {
 public:
  struct Match {
    const Route* route = nullptr;
    PathParameters parameters;
  };

  explicit Router(std::vector<Route> routes);

  /// HEAD is answered as GET. The first route that fits wins.
  /// @throws ApiError kUnknownRoute, or kMethodNotAllowed with the Allow header.
  [[nodiscard]] Match match(std::string_view method, std::string_view path) const;

 private:
  struct Entry {
    Route route;
    std::vector<std::string> parts;
  };
  std::vector<Entry> entries_;
};

}  // namespace stillmap::server
