#pragma once

#include "http/http_message.hpp"

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// Values of the `{name}` parts of a route, by name.
using PathParameters = std::map<std::string, std::string, std::less<>>;
using Handler = std::function<HttpResponse(const HttpRequest&, const PathParameters&)>;

/// What a key must be allowed to do.
enum class Access : std::uint8_t {
  kOpen,           ///< no key is asked for: health, the page
  kOpenWithNames,  ///< the same, but `Caller::may_read` alone is told names of maps
  kRead,
  kLocalize,
  kWrite,
  kAdmin,
  kReadOrLocalize,   ///< either
  kLocalizeOrAdmin,  ///< either; `Caller::is_admin` tells which answer
};

[[nodiscard]] constexpr bool is_open(Access access) {
  return access == Access::kOpen || access == Access::kOpenWithNames;
}

/// How a request's body reaches the handler.
enum class BodyKind : std::uint8_t {
  kNone,      ///< one that comes is not read
  kWhole,     ///< `HttpRequest::body`, within `max_payload_bytes`
  kStreamed,  ///< `HttpRequest::stream`, within `Route::max_body_bytes`
};

struct Route {
  std::string method;
  /// Such as `/v1/maps/{map}/localize`; a `{name}` stands for one non-empty part, `{name}.glb`
  /// for one that ends so.
  std::string pattern;
  Handler handler;
  Access access = Access::kRead;
  BodyKind body = BodyKind::kNone;
  /// Of a streamed body; of a whole one too unless it is 0, where it is less than
  /// `max_payload_bytes`: bodies that no place is reserved for must be small.
  std::uint64_t max_body_bytes = 0;
  /// Asked before the body is read, with the head alone: takes what the request will need (a place
  /// in a queue), which is held until it is answered. @throws ApiError to refuse it early.
  std::function<std::shared_ptr<void>(const HttpRequest&, const PathParameters&)> reserve{};
  /// Whether the handler itself leaves out what is of other maps than a limited key's. Where it
  /// does not and the path has neither `{map}`, `{job}` nor `{session}`, limited keys are refused.
  bool limits_maps = false;
  /// Whether a request that announces no body is one without.
  bool body_is_optional = false;
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
  /// In the order in which they were added.
  [[nodiscard]] std::vector<const Route*> routes() const;

 private:
  struct Entry {
    Route route;
    std::vector<std::string> parts;
  };
  std::vector<Entry> entries_;
};

}  // namespace stillmap::server
