#include "bodies/answers_json.hpp"
#include "context.hpp"
#include "errors/upload_errors.hpp"
#include "security/map_limits.hpp"
#include "store/free_bytes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {
namespace {

std::string map_and_version(const ServedVersion& version) {
  return "map " + version.map + " version " + version.version;
}

/// What keeps nobody from being localized and yet needs somebody soon. Figures of the machine are
/// for callers who may read.
std::vector<std::string> complaints(const Context& context, const Caller& caller) {
  std::vector<std::string> all;
  if (const std::string why = context.store.state().not_writable_because(); !why.empty())
    all.push_back("the store takes no changes: " + without_folder(why, context.store.folder()) +
                  (context.store.state().is_shared()
                       ? "; poses are answered on, and changes are taken when it is back"
                       : "; repair its disk, then start the server again"));
  if (context.store.blobs() != nullptr && context.store.blobs()->figures().is_away)
    all.emplace_back(
        "the packages in S3 cannot be reached (the log says why): poses are answered on, and new "
        "versions are served when it is back");
  const std::uint64_t free = free_bytes(context.store.folder());
  const std::uint64_t reserve = context.store.quota().disk_reserve.value_or(0);
  if (free < reserve)
    all.push_back(
        fmt::format("the disk of the store has {:.0f} MB free, less than its reserve of {:.0f} MB, "
                    "so uploads are refused: remove versions or drives, or enlarge the disk",
                    1e-6 * static_cast<double>(free), 1e-6 * static_cast<double>(reserve)));
  if (const int stuck = context.queue.figures().stuck; stuck > 0)
    all.push_back(
        fmt::format("{} of {} workers are stuck: more than {} s beyond the deadline of "
                    "what they align; start the server again, and report it with its log",
                    stuck, context.workers, AlignmentQueue::kStuckAfter.count()));
  if (all.empty() || caller.may_read) return all;
  return {
      "the server needs attention: a key of the scope read, or the management port, tells more"};
}

/// What stands in the way of some maps. Those that the caller may not see are only counted.
class MapReasons {
 public:
  explicit MapReasons(const Caller& caller) : caller_(caller) {}

  void add(const ServedVersion& version, const std::string& what) {
    if (caller_.may_read && may_use_map(caller_, version.map))
      named_.push_back(map_and_version(version) + ": " + what);
    else
      ++others_;
  }
  [[nodiscard]] bool empty() const { return named_.empty() && others_ == 0; }
  /// @param of_others  what they have in common, such as "loading".
  [[nodiscard]] std::vector<std::string> texts(const std::string& of_others) const {
    std::vector<std::string> texts = named_;
    if (others_ > 0)
      texts.push_back(std::to_string(others_) + (others_ == 1 ? " map: " : " maps: ") + of_others);
    return texts;
  }

 private:
  const Caller& caller_;
  std::vector<std::string> named_;
  std::size_t others_ = 0;
};

/// Ready means that no active version is still being loaded: one that failed does not take the
/// others down.
HttpResponse answer_ready(const Context& context, const Caller& caller) {
  if (context.stopping) return json_response(status_json("stopping", {"stopping"}), 503);
  MapReasons loading(caller);
  MapReasons failed(caller);
  for (const ServedVersion& map : context.catalog.active()) {
    if (map.state == MapState::kFailed) {
      failed.add(map, map.failure);
    } else if (map.state != MapState::kReady) {
      loading.add(map, "loading");
    }
  }
  for (const ServedVersion& map : context.catalog.waiting())
    if (map.state == MapState::kFailed)
      failed.add(map, map.failure + "; the version before is still served");
  if (!loading.empty()) return json_response(status_json("loading", loading.texts("loading")), 503);
  std::vector<std::string> reasons = failed.texts("cannot be used");
  for (std::string& complaint : complaints(context, caller))
    reasons.push_back(std::move(complaint));
  return json_response(status_json("ready", reasons));
}

HttpResponse answer_map_ready(const MapCatalog& catalog, const std::string& name) {
  for (const ServedVersion& map : catalog.active()) {
    if (map.map != name) continue;
    if (map.state == MapState::kReady) return json_response(status_json("ready", {}));
    if (map.state == MapState::kFailed)
      return json_response(status_json("failed", {map.failure}), 503);
    return json_response(status_json("loading", {map_and_version(map) + ": loading"}), 503);
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
  routes.push_back({"GET", "/readyz",
                    [&context](const HttpRequest& request, const PathParameters&) {
                      return answer_ready(context, request.caller);
                    },
                    Access::kOpenWithNames});
  routes.push_back({"GET", "/v1/maps/{map}/ready",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return answer_map_ready(context.catalog, path.at("map"));
                    },
                    Access::kReadOrLocalize});
  routes.push_back({.method = "GET",
                    .pattern = "/v1/status",
                    .handler =
                        [&context](const HttpRequest& request, const PathParameters&) {
                          return answer_status(context, request.caller);
                        },
                    .limits_maps = true});
}

}  // namespace stillmap::server
