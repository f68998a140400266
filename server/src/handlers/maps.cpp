#include "bodies/layers_json.hpp"
#include "bodies/maps_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"
#include "errors/upload_errors.hpp"
#include "handlers/flat_parameters.hpp"
#include "handlers/page_query.hpp"
#include "handlers/tile_answer.hpp"
#include "security/map_limits.hpp"

#include <fmt/format.h>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_graph.hpp>
#include "store/store_refusal.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <memory>
#include <optional>
#include <semaphore>
#include <string>
#include <utility>

namespace stillmap::server {
namespace {

/// So many parts of whole maps are read and told at one time: of a city's drives each may take some
/// 100 MB. The text waits for its client without a place.
constexpr int kMostReadAtOnce = 4;
constexpr std::chrono::seconds kMostWait{10};

class ReadPlaces {
 public:
  /// Waits for a place, which is held as long as what is returned. @throws ApiError kBusy.
  static std::shared_ptr<void> take(const std::shared_ptr<ReadPlaces>& places) {
    if (!places->free_.try_acquire_for(kMostWait))
      throw ApiError(ErrorCode::kBusy, "others are reading such parts of maps")
          .with_header("Retry-After", "5");
    return {places.get(), [places](void*) { places->free_.release(); }};
  }

 private:
  std::counting_semaphore<kMostReadAtOnce> free_{kMostReadAtOnce};
};

/// Of the files that such a part is told from: what was damaged must not be kept by clients for
/// ever.
/// @throws maps::InputError naming the file.
void require_whole_texts(const maps::MapPackage& map) {
  for (const auto& [path, file] : map.manifest().files) {
    if (!path.ends_with(".json") && !path.ends_with(".tum")) continue;
    const std::string found = maps::sha256_of_file(map.folder() / path);
    if (found != file.sha256)
      throw maps::InputError((map.folder() / path).string(), "SHA-256 " + found,
                             file.sha256 + " as in manifest.json; add the same package again");
  }
}

/// A route of what a version holds, which never changes; nothing is read for who has it already.
/// @param form  counts up when the same content would be told in other words.
Route part_route(const Context& context, const std::shared_ptr<ReadPlaces>& places,
                 const std::string& name, int form, std::string (*text)(const maps::MapPackage&)) {
  return {
      "GET", "/v1/maps/{map}/versions/{version}/" + name,
      [&context, places, name, form, text](const HttpRequest& request, const PathParameters& path) {
        const ServedVersion map = find_version(context.catalog, path);
        const std::string etag =
            fmt::format("\"{}-{}-{}\"", map.package->digest().substr(0, 16), name, form);
        return immutable_answer(request, etag, [&](HttpResponse& response) {
          const std::shared_ptr<void> place = ReadPlaces::take(places);
          require_whole_texts(*map.package);
          response.content_type = "application/json";
          response.body = text(*map.package);
        });
      }};
}

/// As it is served, or will be as soon as it is loaded. @param version  the active one by the
/// store.
ServedVersion loading_unless_known(ServedVersion version) {
  if (version.state == MapState::kOpened) version.state = MapState::kLoading;
  return version;
}

/// What is told of a map is of one state of the store: where another process has made a version the
/// active one, that is told, though this server serves the one before until it has loaded it.
HttpResponse answer_list(const Context& context, const Caller& caller) {
  std::vector<ListedMap> maps;
  for (StoredMap& map : context.store.state().maps()) {
    if (!may_use_map(caller, map.name)) continue;
    ListedMap& listed = maps.emplace_back(ListedMap{std::move(map), std::nullopt, std::nullopt});
    if (!listed.stored.active) continue;
    const std::string& name = listed.stored.name;
    const std::string& version = *listed.stored.active;
    const ServedVersion unknown{.map = name, .version = version, .state = MapState::kLoading};
    listed.served = loading_unless_known(context.catalog.known(name, version).value_or(unknown));
    const auto stored = context.store.state().find_version(name, version);
    if (stored) listed.described = describe_version(context, name, *stored);
  }
  return json_response(map_list_json(maps));
}

/// What the build wrote down, else what its poses tell.
ShownGraph graph_of(const maps::MapPackage& map) {
  ShownGraph shown;
  if (std::optional<maps::MapGraph> graph = maps::read_map_graph(map)) {
    shown.is_of_the_build = true;
    shown.graph = std::move(*graph);
    return shown;
  }
  shown.graph.key_frames = maps::derived_key_frames(map.trajectories());
  // Given poses are not held together by loops.
  const auto& options = map.manifest().options;
  const auto odometry = options.find("odometry");
  shown.knows_loops = odometry == options.end() || odometry->second == "given";
  return shown;
}

/// The version that the path names, else the one that a vehicle gets.
/// @param map  as the store has it now, so that the revision of the answer is that of its version.
ServedVersion told_version(const Context& context, const StoredMap& map, const PathParameters& path,
                           const std::string& vehicle) {
  if (version_in(path)) return find_version(context.catalog, path);
  const std::optional<Rollout> rollout = context.catalog.rollout(map.name);
  if (rollout && !vehicle.empty()) {
    ServedVersion version = context.catalog.find_for(map.name, vehicle);
    if (version.version == rollout->version) return version;
  }
  return loading_unless_known(context.catalog.find(map.name, *map.active));
}

/// @param map  as of `told_version`.
std::string one_version(const Context& context, const StoredMap& map, const PathParameters& path,
                        const std::string& vehicle) {
  const ServedVersion version = told_version(context, map, path, vehicle);
  context.vehicles.seen(map.name, vehicle, version.version, {}, unix_ns());
  const auto stored = context.store.state().find_version(version.map, version.version);
  return map_json(map, version,
                  stored ? describe_version(context, version.map, *stored) : DescribedVersion{});
}

/// The version that was active at the time that `as_of` in the query says; nothing without one.
/// @throws ApiError kInvalidRequest, kUnknownVersion.
std::optional<std::string> version_as_of(const Context& context, const HttpRequest& request,
                                         const std::string& map) {
  const auto values = read_query(request, {"as_of", "vehicle"});
  const auto text = values.find("as_of");
  if (text == values.end()) return std::nullopt;
  const std::optional<std::int64_t> time_ns = time_in(text->second);
  if (!time_ns)
    throw field_error(ErrorCode::kInvalidRequest, "as_of", "'" + text->second + "'",
                      "a time in UTC such as 2026-11-29T10:30:00Z, or nanoseconds since 1970");
  std::string version = context.store.state().active_at(map, *time_ns);
  if (!context.store.state().find_version(map, version))
    throw ApiError(ErrorCode::kUnknownVersion,
                   "version '" + version + "' of map '" + map +
                       "' was active then and has been removed since; retention.versions says how "
                       "many are kept");
  return version;
}

}  // namespace

DescribedVersion describe_version(const Context& context, const std::string& map,
                                  const StoredVersion& version) {
  DescribedVersion found{.stored = version, .state = "stored"};
  if (const auto open = context.catalog.known(map, version.name)) {
    found.state = name_of(open->state);
    found.failure = open->failure;
  }
  try {
    found.facts = context.catalog.facts().of(map, version);
    found.frame = context.catalog.facts().frame_of(map, version.digest);
    if (found.facts->registered_to)
      found.registered_to = context.store.state().current_digest(*found.facts->registered_to);
  } catch (const StoreRefusal&) {
    // Removed just now.
  } catch (const std::exception& error) {
    found.state = name_of(MapState::kFailed);
    found.failure = without_places(error.what(), context.store);
  }
  return found;
}

void add_map_routes(std::vector<Route>& routes, const Context& context) {
  const Handler one = [&context](const HttpRequest& request, const PathParameters& names) {
    const StoredMap map = context.store.state().map(names.at("map"));
    PathParameters path = names;
    if (!version_in(path))
      if (const auto version = version_as_of(context, request, map.name))
        path.emplace("version", *version);
    const std::string vehicle = version_in(path) ? "" : read_vehicle(request.query);
    // A map without an active version is there all the same.
    HttpResponse response =
        json_response(!map.active && !version_in(path) ? stored_map_json(map)
                                                       : one_version(context, map, path, vehicle));
    response.headers.emplace_back("ETag", etag_of(map));
    return response;
  };
  routes.push_back({.method = "GET",
                    .pattern = "/v1/maps",
                    .handler =
                        [&context](const HttpRequest& request, const PathParameters&) {
                          return answer_list(context, request.caller);
                        },
                    .limits_maps = true});
  routes.push_back({"GET", "/v1/maps/{map}", one});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}", one});
  const auto add_part = [&, places = std::make_shared<ReadPlaces>()](const char* name,
                                                                     const auto& text) {
    routes.push_back(part_route(context, places, name, 1, text));
  };
  add_part("trajectory",
           [](const maps::MapPackage& map) { return trajectories_json(map.trajectories()); });
  add_part("objects", [](const maps::MapPackage& map) { return objects_json(map.objects()); });
  add_part("graph", [](const maps::MapPackage& map) { return graph_json(graph_of(map)); });
}

}  // namespace stillmap::server
