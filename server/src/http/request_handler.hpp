#pragma once

#include "http/http_message.hpp"
#include "http/router.hpp"

namespace stillmap::server {

/// Requests in, answers out, whatever brings them. Safe from several threads.
class RequestHandler {
 public:
  virtual ~RequestHandler() = default;

  /// Decides by the head alone whether the request may send its body: finds the route, checks the
  /// key, reserves what is needed. Fills the request's caller and reservation.
  /// @throws ApiError if not.
  [[nodiscard]] virtual Router::Match admit(HttpRequest& request) const = 0;
  /// Answers what was admitted. Never throws: what goes wrong becomes a problem document.
  [[nodiscard]] virtual HttpResponse handle(const HttpRequest& request,
                                            const Router::Match& match) const = 0;
};

}  // namespace stillmap::server
