#pragma once

#include "api_error.hpp"
#include "gatekeeper.hpp"
#include "handlers/context.hpp"
#include "problem.hpp"
#include "request_handler.hpp"
#include "web_assets.hpp"

#include <atomic>

namespace stillmap::server {

/// Requests in, answers out: everything of the server but HTTP itself. Safe from several threads.
class Service final : public RequestHandler {
 public:
  /// @param store  outlives this. @throws std::invalid_argument on broken options.
  Service(const ServerOptions& options, maps::PackageStore& store, AlignerBuilder builder,
          const std::vector<WebAsset>& web);
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  [[nodiscard]] Router::Match admit(HttpRequest& request) const override;
  [[nodiscard]] HttpResponse handle(const HttpRequest& request,
                                    const Router::Match& match) const override;
  /// Both at once, for a request that is complete.
  [[nodiscard]] HttpResponse handle(HttpRequest request) const;
  [[nodiscard]] Metrics& metrics() const { return metrics_; }
  [[nodiscard]] const Router& router() const { return router_; }
  /// Options that may change while it runs; the others of these are not looked at.
  /// @throws std::invalid_argument on broken options; those before stay in force.
  void reload(const ServerOptions& options);
  /// From now on it is not ready, and says why.
  void set_stopping() { stopping_ = true; }

 private:
  ServerOptions options_;
  OptionsHolder live_;
  maps::PackageStore& store_;
  mutable Metrics metrics_;
  std::atomic<bool> stopping_ = false;
  mutable Gatekeeper gatekeeper_;
  mutable MapCatalog catalog_;
  mutable maps::DriveStore drives_;
  mutable UploadPlaces uploads_;
  int workers_;
  mutable AlignmentQueue queue_;
  mutable SessionTable sessions_;
  Context context_;
  Router router_;
};

}  // namespace stillmap::server
