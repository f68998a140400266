#pragma once

#include "bodies/maps_json.hpp"
#include "catalog/map_catalog.hpp"
#include "http/router.hpp"
#include "http/shared_places.hpp"
#include "jobs/jobs.hpp"
#include "metrics/metrics.hpp"
#include "pose/alignment_queue.hpp"
#include "pose/map_stats.hpp"
#include "pose/rollout_counts.hpp"
#include "pose/session_table.hpp"
#include "pose/vehicle_table.hpp"
#include "sealing/session_seals.hpp"
#include "store/ids_and_times.hpp"

#include <stillmap/server/options_holder.hpp>
#include "store/drive_store.hpp"

#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

class MapLayers;
class MapViews;

/// What the handlers work with; outlives them.
struct Context {
  /// As at the start.
  const ServerOptions& options;
  /// In force now, for those that a reload changes.
  const OptionsHolder& live;
  int workers;
  PackageStore& store;
  DriveStore& drives;
  SharedPlaces& uploads;
  MapCatalog& catalog;
  MapViews& views;
  MapLayers& layers;
  AlignmentQueue& queue;
  SessionTable& sessions;
  SessionSeals& seals;
  Jobs& jobs;
  Metrics& metrics;
  MapStats& stats;
  VehicleTable& vehicles;
  RolloutCounts& rollout_counts;
  /// Once set, the server is about to end.
  const std::atomic<bool>& stopping;
  std::chrono::steady_clock::time_point started;
};

[[nodiscard]] inline HttpResponse json_response(std::string body, int status = 200) {
  return {
      .status = status, .content_type = "application/json", .body = std::move(body), .headers = {}};
}

/// Every handler file adds its routes.
void add_health_routes(std::vector<Route>& routes, const Context& context);
void add_map_routes(std::vector<Route>& routes, const Context& context);
void add_map_change_routes(std::vector<Route>& routes, const Context& context);
void add_version_routes(std::vector<Route>& routes, const Context& context);
void add_package_routes(std::vector<Route>& routes, const Context& context);
void add_upload_routes(std::vector<Route>& routes, const Context& context);
void add_drive_routes(std::vector<Route>& routes, const Context& context);
void add_signature_routes(std::vector<Route>& routes, const Context& context);
void add_edit_routes(std::vector<Route>& routes, const Context& context);
void add_rebuild_routes(std::vector<Route>& routes, const Context& context);
void add_job_routes(std::vector<Route>& routes, const Context& context);
void add_audit_routes(std::vector<Route>& routes, const Context& context);
void add_key_routes(std::vector<Route>& routes, const Context& context);
void add_layer_routes(std::vector<Route>& routes, const Context& context);
void add_tile_routes(std::vector<Route>& routes, const Context& context);
void add_tileset_routes(std::vector<Route>& routes, const Context& context);
void add_difference_routes(std::vector<Route>& routes, const Context& context);
void add_localize_routes(std::vector<Route>& routes, const Context& context);
void add_batch_routes(std::vector<Route>& routes, const Context& context);
void add_session_routes(std::vector<Route>& routes, const Context& context);
void add_sealed_session_routes(std::vector<Route>& routes, const Context& context);
void add_rollout_routes(std::vector<Route>& routes, const Context& context);
void add_set_routes(std::vector<Route>& routes, const Context& context);
void add_stats_routes(std::vector<Route>& routes, const Context& context);
void add_openapi_routes(std::vector<Route>& routes);

/// Whether the path's part of this name may name a map or a version. @throws ApiError if not.
void check_name(const PathParameters& path, const std::string& part);
/// @throws ApiError kUnsupportedMediaType unless Content-Type is application/json, so that no
/// HTML form of another site can send it.
void require_json(const HttpRequest& request);
/// The same where a body may be missing.
void require_json_if_any(const HttpRequest& request);
/// 202, with the place of the job.
[[nodiscard]] HttpResponse accepted(const JobView& job);
/// Whether one of the tags of If-None-Match is ours; `*` means any.
[[nodiscard]] bool is_known_to_client(const std::string& if_none_match, const std::string& etag);
/// Whether the query says `FLAG=true`. @throws ApiError for anything else in it.
[[nodiscard]] bool flag_in_query(const HttpRequest& request, std::string_view flag);
/// The state of a map's active pointer, for If-Match.
[[nodiscard]] std::string etag_of(const StoredMap& map);
/// What stands in the path's place of a version, if it has one.
[[nodiscard]] std::optional<std::string_view> version_in(const PathParameters& path);
/// A version as lists show it; one that cannot be read says why.
[[nodiscard]] DescribedVersion describe_version(const Context& context, const std::string& map,
                                                const StoredVersion& version);
/// The version that the path names; the one that is served when it names none.
/// @throws as `MapCatalog::find`.
[[nodiscard]] ServedVersion find_version(MapCatalog& catalog, const PathParameters& path);

}  // namespace stillmap::server
