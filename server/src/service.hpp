#pragma once

#include "catalog/map_layers.hpp"
#include "catalog/map_views.hpp"
#include "errors/api_error.hpp"
#include "handlers/context.hpp"
#include "http/problem.hpp"
#include "http/request_handler.hpp"
#include "jobs/housekeeping.hpp"
#include "security/gatekeeper.hpp"
#include "web_assets.hpp"

#include <stillmap/server/server.hpp>

#include <atomic>
#include <filesystem>

namespace stillmap::server {

/// Requests in, answers out: everything of the server but HTTP itself. Safe from several threads.
class Service final : public RequestHandler {
 public:
  /// @param store   outlives this. @param mapper  program that does the jobs; empty when there is
  /// none. @throws std::invalid_argument on broken options.
  Service(const ServerOptions& options, PackageStore& store, AlignerBuilder builder,
          const std::vector<WebAsset>& web, const std::filesystem::path& mapper = {},
          StoreChanges changes = StoreChanges::kTaken);
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  [[nodiscard]] Router::Match find(const HttpRequest& request) const override;
  void admit(HttpRequest& request, const Router::Match& match) const override;
  /// Both at once.
  [[nodiscard]] Router::Match admit(HttpRequest& request) const;
  [[nodiscard]] HttpResponse handle(const HttpRequest& request,
                                    const Router::Match& match) const override;
  /// All at once, for a request that is complete.
  [[nodiscard]] HttpResponse handle(HttpRequest request) const;
  /// Everything that is served, in the order of the table.
  [[nodiscard]] std::vector<const Route*> routes() const { return router_.routes(); }
  [[nodiscard]] Metrics& metrics() const { return metrics_; }
  /// Options that may change while it runs; the others of these are not looked at.
  /// @throws std::invalid_argument on broken options; those before stay in force.
  void reload(const ServerOptions& options);
  /// As `Server::prepare_trust`.
  [[nodiscard]] std::function<void()> prepare_trust(const ServerOptions& next);
  /// From now on it is not ready, and says why.
  void set_stopping() { stopping_ = true; }

 private:
  [[nodiscard]] HttpResponse answer(const HttpRequest& request, const Router::Match& match) const;
  void note_write(const HttpRequest& request, const Router::Match& match, int status) const;
  void note_refused(const HttpRequest& request, const Router::Match& match,
                    const ApiError& error) const;
  void add_metrics();

  ServerOptions options_;
  OptionsHolder live_;
  PackageStore& store_;
  StoreChanges changes_;
  mutable Metrics metrics_;
  std::atomic<bool> stopping_ = false;
  mutable Gatekeeper gatekeeper_;
  /// Of rows that anybody can make.
  mutable RateLimits refused_rows_;
  mutable MapViews views_;
  mutable MapLayers layers_;
  mutable MapCatalog catalog_;
  mutable DriveStore drives_;
  mutable SharedPlaces uploads_;
  int workers_;
  mutable AlignmentQueue queue_;
  mutable SessionTable sessions_;
  mutable SessionSeals seals_;
  mutable MapStats stats_;
  mutable VehicleTable vehicles_;
  mutable RolloutCounts rollout_counts_;
  mutable Jobs jobs_;
  Context context_;
  Router router_;
  Housekeeping housekeeping_;
};

}  // namespace stillmap::server
