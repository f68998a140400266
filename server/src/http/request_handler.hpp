#pragma once

#include "http/http_message.hpp"
#include "http/router.hpp"

namespace stillmap::server {

/// Requests in, answers out, whatever brings them. Safe from several threads.
class RequestHandler {
 public:
  virtual ~RequestHandler() = default;

  /// Finds the route by method and path. @throws ApiError as `Router::match`.
  [[nodiscard]] virtual Router::Match find(const HttpRequest& request) const = 0;
  /// Decides by the head alone whether the request may send its body: checks the key, reserves what
  /// is needed. Fills the request's caller, also where it refuses, and reservation.
  /// @param match  what `find` returned. @throws ApiError if not.
  virtual void admit(HttpRequest& request, const Router::Match& match) const = 0;
  /// Answers what was admitted. Never throws: what goes wrong becomes a problem document.
  [[nodiscard]] virtual HttpResponse handle(const HttpRequest& request,
                                            const Router::Match& match) const = 0;
};

}  // namespace stillmap::server
