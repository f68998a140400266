#pragma once

#include "api_error.hpp"
#include "handlers/context.hpp"
#include "web_assets.hpp"

#include <string_view>

namespace stillmap::server {

/// Requests in, answers out: everything of the server but HTTP itself. Safe from several threads.
class Service {
 public:
  /// @throws std::invalid_argument on broken options.
  Service(const ServerOptions& options, const maps::MapStore& store, AlignerBuilder builder,
          const std::vector<WebAsset>& web);
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  /// Whether anything answers here, asked before a body is read. @throws ApiError if not.
  void check_route(std::string_view method, std::string_view path) const;
  /// Never throws: what goes wrong becomes a problem document.
  [[nodiscard]] HttpResponse handle(const HttpRequest& request) const;

 private:
  [[nodiscard]] HttpResponse dispatch(const HttpRequest& request) const;

  ServerOptions options_;
  MapCatalog catalog_;
  int workers_;
  mutable AlignmentGate gate_;
  Context context_;
  Router router_;
};

/// An error as `application/problem+json`.
[[nodiscard]] HttpResponse problem_response(const ApiError& error, const std::string& request_id);

}  // namespace stillmap::server
