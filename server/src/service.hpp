#pragma once

#include "api_error.hpp"
#include "gatekeeper.hpp"
#include "handlers/context.hpp"
#include "web_assets.hpp"

namespace stillmap::server {

/// Requests in, answers out: everything of the server but HTTP itself. Safe from several threads.
class Service {
 public:
  /// @throws std::invalid_argument on broken options.
  Service(const ServerOptions& options, const maps::MapStore& store, AlignerBuilder builder,
          const std::vector<WebAsset>& web);
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  /// Decides by the head alone whether the request may send its body: finds the route, checks the
  /// key, reserves what is needed. Fills the request's caller and reservation.
  /// @throws ApiError if not.
  [[nodiscard]] Router::Match admit(HttpRequest& request) const;
  /// Answers what was admitted. Never throws: what goes wrong becomes a problem document.
  [[nodiscard]] HttpResponse handle(const HttpRequest& request, const Router::Match& match) const;
  /// Both at once, for a request that is complete.
  [[nodiscard]] HttpResponse handle(HttpRequest request) const;

 private:
  ServerOptions options_;
  Gatekeeper gatekeeper_;
  MapCatalog catalog_;
  int workers_;
  mutable AlignmentGate gate_;
  Context context_;
  Router router_;
};

/// An error as `application/problem+json`.
[[nodiscard]] HttpResponse problem_response(const ApiError& error, const std::string& request_id);

}  // namespace stillmap::server
