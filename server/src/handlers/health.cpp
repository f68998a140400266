#include "context.hpp"
#include "errors/upload_errors.hpp"
#include "jobs/job_folder.hpp"
#include "json/answers_json.hpp"
#include "security/map_limits.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {
namespace {

std::string described(const ServedVersion& version) {
  return "map " + version.map + " version " + version.version;
}

/// What keeps nobody from being localized and yet needs somebody soon.
std::vector<std::string> complaints(const Context& context) {
  std::vector<std::string> all;
  if (const std::string why = context.store.state().not_writable_because(); !why.empty())
    all.push_back("the store takes no changes: " + without_folder(why, context.store.folder()) +
                  "; mend its disk, then start the server again");
  const std::uint64_t free = free_bytes(context.store.folder());
  const std::uint64_t reserve = context.store.quota().disk_reserve.value_or(0);
  if (free < reserve)
    all.push_back(
        fmt::format("the disk of the store has {} bytes free, fewer than its reserve of "
                    "{}, so uploads are refused; remove versions or drives, or enlarge it",
                    free, reserve));
  if (const int stuck = context.queue.figures().stuck; stuck > 0)
    all.push_back(
        fmt::format("{} of {} workers are stuck: more than {} s beyond the deadline of "
                    "what they align; start the server again, and report it with its log",
                    stuck, context.workers, AlignmentQueue::kStuckAfter.count()));
  return all;
}

/// Ready means that no active version is still being loaded: one that failed does not take the
/// others down.
HttpResponse answer_ready(const Context& context) {
  if (context.stopping) return json_response(status_json("stopping", {"stopping"}), 503);
  std::vector<std::string> loading;
  std::vector<std::string> failed;
  for (const ServedVersion& map : context.catalog.active()) {
    if (map.state == MapState::kFailed) {
      failed.push_back(described(map) + ": " + map.failure);
    } else if (map.state != MapState::kReady) {
      loading.push_back(described(map) + ": loading");
    }
  }
  for (const ServedVersion& map : context.catalog.waiting())
    if (map.state == MapState::kFailed)
      failed.push_back(described(map) + ": " + map.failure + "; the one before goes on");
  if (!loading.empty()) return json_response(status_json("loading", loading), 503);
  for (std::string& complaint : complaints(context)) failed.push_back(std::move(complaint));
  return json_response(status_json("ready", failed));
}

HttpResponse answer_map_ready(const MapCatalog& catalog, const std::string& name) {
  for (const ServedVersion& map : catalog.active()) {
    if (map.map != name) continue;
    if (map.state == MapState::kReady) return json_response(status_json("ready", {}));
    if (map.state == MapState::kFailed)
      return json_response(status_json("failed", {map.failure}), 503);
    return json_response(status_json("loading", {described(map) + ": loading"}), 503);
  }
  (void)catalog.find(name);  // says why there is none
  return json_response(status_json("loading", {}), 503);
}

HttpResponse answer_status(const Context& context, const Caller& caller) {
  const std::vector<ServedVersion> active = context.catalog.active();
  const std::chrono::duration<double> uptime = std::chrono::steady_clock::now() - context.started;
  return json_response(server_status_json(
      {.version = STILLMAP_VERSION,
       .maps = static_cast<std::size_t>(
           std::count_if(active.begin(), active.end(),
                         [&](const ServedVersion& each) { return may_use_map(caller, each.map); })),
       .uptime_s = uptime.count(),
       .workers = context.workers},
      *context.live.current()));
}

}  // namespace

void add_health_routes(std::vector<Route>& routes, const Context& context) {
  const Handler alive = [](const HttpRequest&, const PathParameters&) {
    return json_response(status_json("alive", {}));
  };
  routes.push_back({"GET", "/livez", alive, Access::kOpen});
  routes.push_back({"GET", "/healthz", alive, Access::kOpen});
  routes.push_back(
      {"GET", "/readyz",
       [&context](const HttpRequest&, const PathParameters&) { return answer_ready(context); },
       Access::kOpen});
  routes.push_back({"GET", "/v1/maps/{map}/ready",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return answer_map_ready(context.catalog, path.at("map"));
                    },
                    Access::kOpen});
  routes.push_back({.method = "GET",
                    .pattern = "/v1/status",
                    .handler =
                        [&context](const HttpRequest& request, const PathParameters&) {
                          return answer_status(context, request.caller);
                        },
                    .limits_maps = true});
}

}  // namespace stillmap::server
