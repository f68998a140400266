#pragma once

#include "http_message.hpp"
#include "router.hpp"

namespace stillmap::server {

/// Says who may do what, before a request's body is read. There are no keys yet: everyone who
/// reaches the server may do everything.
class Gatekeeper {
 public:
  /// @throws ApiError when the request's key does not allow it.
  [[nodiscard]] Caller admit(const HttpRequest& /*request*/, Access /*access*/) const { return {}; }
};

}  // namespace stillmap::server
