#pragma once

#include "map_catalog.hpp"
#include "pose/alignment_queue.hpp"
#include "pose/session_table.hpp"
#include "router.hpp"

#include <stillmap/server/server_options.hpp>

#include <chrono>
#include <string>
#include <vector>

namespace stillmap::server {

/// What the handlers work with; outlives them.
struct Context {
  const ServerOptions& options;
  int workers;
  MapCatalog& catalog;
  AlignmentQueue& queue;
  SessionTable& sessions;
  std::chrono::steady_clock::time_point started;
};

[[nodiscard]] inline HttpResponse json_response(std::string body, int status = 200) {
  return {
      .status = status, .content_type = "application/json", .body = std::move(body), .headers = {}};
}

/// Every handler file adds its routes.
void add_health_routes(std::vector<Route>& routes, const Context& context);
void add_map_routes(std::vector<Route>& routes, const Context& context);
void add_tile_routes(std::vector<Route>& routes, const Context& context);
void add_localize_routes(std::vector<Route>& routes, const Context& context);
void add_batch_routes(std::vector<Route>& routes, const Context& context);
void add_session_routes(std::vector<Route>& routes, const Context& context);

/// The map, when `version` is the one it has. @throws ApiError kUnknownMap, kUnknownVersion.
[[nodiscard]] ServedMap find_version(const MapCatalog& catalog, const PathParameters& path);

}  // namespace stillmap::server
