#include "errors/api_error.hpp"
#include "handlers/flat_parameters.hpp"
#include "handlers/session_scan.hpp"
#include "handlers/set_maps.hpp"
#include "pose_response.hpp"
#include "sealing/session_seals.hpp"
#include "security/map_limits.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include "store/store_refusal.hpp"

#include <optional>
#include <string>
#include <utility>
#include <vector>

/// Sessions whose state travels with the vehicle: any server of the store goes on with any of them.
namespace stillmap::server {
namespace {

constexpr const char* kSealHeader = "Stillmap-Seal";

/// What a request is for: a map of the path, or a set.
struct SealedScope {
  const PathParameters& path;
  std::optional<MapSet> set;
};

SealOwner owner_of(const HttpRequest& request, const SealedScope& scope) {
  return {.key_id = request.caller.key_id,
          .map = scope.set ? "set/" + scope.set->name : scope.path.at("map")};
}

/// Of a seal that comes without the name of its set, the one that it was made for: there may be
/// more sets by now.
std::optional<MapSet> set_of_seal(const Context& context, const HttpRequest& request,
                                  const PathParameters& path) {
  const std::string seal = request.header("stillmap-seal");
  if (seal.empty()) return std::nullopt;
  for (MapSet& set : seen_sets(context, request.caller)) {
    const SealedScope scope{path, std::move(set)};
    try {
      (void)context.seals.open(seal, owner_of(request, scope));
      return scope.set;
    } catch (const ApiError& error) {
      if (error.code() != ErrorCode::kInvalidSeal) return scope.set;
    }
  }
  return std::nullopt;
}

SealedScope scope_of(const Context& context, const HttpRequest& request,
                     const PathParameters& path) {
  if (path.contains("map")) return {path, std::nullopt};
  const std::string name = read_set(request.query);
  if (name.empty())
    if (auto set = set_of_seal(context, request, path)) return {path, std::move(set)};
  return {path, wanted_set(context, request.caller, name)};
}

std::string hex_of(const std::string& id) {
  std::string hex;
  for (const char each : id) hex += fmt::format("{:02x}", static_cast<unsigned char>(each));
  return hex;
}

/// What a request goes on from: its seal, or a session that begins.
struct SealedStart {
  SealedSession session;
  ServedVersion map;
  bool is_new = true;
  /// Empty without one.
  SetOfRequest set{};
};

[[noreturn]] void refuse_version(const SealedSession& session, const std::string& why) {
  throw ApiError(ErrorCode::kSealedVersionGone,
                 fmt::format("the seal goes on with version '{}', {}: begin anew without a seal, "
                             "with the last pose as a prior if the new version has the same frame",
                             session.version, why));
}

/// The version that a seal names, as long as there is one with its digest.
ServedVersion sealed_version(const Context& context, const std::string& map,
                             const SealedSession& session) {
  try {
    ServedVersion served = context.catalog.ready(map, session.version);
    if (served.package->digest() != session.digest)
      refuse_version(session, "which has another content now");
    return served;
  } catch (const StoreRefusal& refusal) {
    if (refusal.reason() != StoreRefusal::Reason::kUnknownVersion) throw;
    refuse_version(session, "which was removed");
  }
}

/// Else a vehicle would stay in a version that was halted as long as it drives.
/// @return the version that it would get now.
std::string require_rollout(const Context& context, const std::string& map,
                            SealedSession& session) {
  const auto active = version_now(context.catalog, map, {});
  const auto now =
      session.version_was_named ? active : version_now(context.catalog, map, session.vehicle);
  if (!now || !active) return session.version;
  if (*active == session.version) session.is_rolled_out = false;
  if (session.is_rolled_out && *now != session.version)
    refuse_version(session, "whose roll-out has ended for this vehicle");
  return *now;
}

void require_same(const HttpRequest& request, const PathParameters& path,
                  const SealedSession& session) {
  const auto require = [](std::string_view what, std::string_view found,
                          const std::string& sealed) {
    if (found == sealed) return;
    throw field_error(ErrorCode::kInvalidRequest, std::string(what), fmt::format("'{}'", found),
                      fmt::format("'{}', as the session began: leave it out; or leave out the "
                                  "seal, to begin anew",
                                  sealed));
  };
  if (const auto version = version_in(path)) require("version", *version, session.version);
  const std::string vehicle = read_vehicle(request.query);
  if (!vehicle.empty()) require(kVehicleParameter, vehicle, session.vehicle);
}

void require_member(const MapSet& set, const Caller& caller, const SealedSession& session) {
  require_map(caller, session.map);
  for (const MapSet::Member& member : set.maps)
    if (member.map == session.map) return;
  refuse_version(session, "of map '" + session.map + "', which the set no longer has");
}

/// @param place  where a session begins.
/// @throws ApiError for a seal that nothing goes on from, and as `MapCatalog::ready` and
/// `candidates_in`.
SealedStart start_of(const Context& context, const HttpRequest& request, const SealedScope& scope,
                     const PlaceInSet& place) {
  const std::string text = request.header("stillmap-seal");
  SealedStart start;
  start.is_new = text.empty();
  if (!start.is_new) {
    start.session = context.seals.open(text, owner_of(request, scope));
    require_same(request, scope.path, start.session);
  }
  const std::string vehicle = start.is_new ? read_vehicle(request.query) : start.session.vehicle;
  if (scope.set) start.set = maps_of(context, *scope.set, vehicle);
  if (start.is_new) {
    // In a set its first scan tells which.
    start.map = scope.set ? candidates_in(start.set, place).maps.front().in->map
                          : ready_version(context, request, scope.path);
    start.session = context.seals.begin();
    start.session.version = start.map.version;
    start.session.vehicle = vehicle;
    start.session.version_was_named = version_in(scope.path).has_value();
    start.session.is_rolled_out =
        !start.session.version_was_named && is_rolled_out(context.catalog, start.map);
    return start;
  }
  if (scope.set) require_member(*scope.set, request.caller, start.session);
  const std::string& map = scope.set ? start.session.map : scope.path.at("map");
  if (const std::string why = context.catalog.distrust_of(map, start.session.version); !why.empty())
    throw ApiError(ErrorCode::kNotSigned, why);
  start.map = sealed_version(context, map, start.session);
  return start;
}

/// @throws ApiError for a place that a session cannot begin at.
void check_place(const SealedStart& start, const PoseParameters& parameters) {
  if (!start.is_new && (parameters.prior || parameters.gnss))
    throw field_error(ErrorCode::kInvalidRequest, parameters.prior ? "prior" : "gnss",
                      "a place beside a seal", "one of the two: leave out the seal to begin anew");
  if (parameters.prior && !parameters.prior->covariance)
    throw field_error(
        ErrorCode::kInvalidPrior, "prior.covariance", "nothing",
        "36 numbers, or prior_sigma: a session weighs the prior against what follows");
}

localization::Tracker tracker_of(const SealedStart& start) {
  const auto& aligner = start.map.aligners->front().second;
  const localization::TrackerOptions& options = start.map.localization.tracker;
  if (start.is_new) return localization::Tracker(aligner, options);
  try {
    return localization::Tracker::restored(aligner, options, start.session.tracker);
  } catch (const maps::InputError&) {
    throw ApiError(ErrorCode::kInvalidSeal,
                   "the seal comes from another version of the program: begin anew without a seal");
  }
}

void require_newer(const localization::Tracker& tracker, std::int64_t stamp_ns) {
  const auto newest_ns = tracker.newest_ns();
  if (!newest_ns || stamp_ns > *newest_ns) return;
  throw field_error(ErrorCode::kScanNotNewer, "stamp_ns", std::to_string(stamp_ns),
                    fmt::format("more than {}, the stamp of the seal's scan: send a newer scan, or "
                                "begin anew without a seal if the clock was set back",
                                *newest_ns));
}

/// The vehicle as it is before the scan. @param parameters  get the prior in the map, where the map
/// is known before the scan is matched.
SetVehicle vehicle_of(const SealedStart& start, PoseParameters& parameters) {
  SetVehicle vehicle{.map = start.map,
                     .tracker = tracker_of(start),
                     .is_rolled_out = start.session.is_rolled_out,
                     .begin = {}};
  require_newer(vehicle.tracker, *parameters.stamp_ns);
  if (!start.is_new) return vehicle;
  if (!start.set.maps.empty()) {
    vehicle.begin = PlaceInSet{parameters.prior, parameters.gnss};
    parameters.prior.reset();
    return vehicle;
  }
  parameters.prior = prior_in(start.map, parameters.prior, parameters.gnss);
  if (const auto& prior = parameters.prior)
    vehicle.tracker.initialize(prior->T_map_lidar, prior->covariance.value());
  return vehicle;
}

/// Where the vehicle is after the scan, for the seal.
void note(SealedSession& session, const SetVehicle& vehicle, bool in_set) {
  if (in_set) session.map = vehicle.map.map;
  session.version = vehicle.map.version;
  session.digest = vehicle.map.package->digest();
  session.is_rolled_out = vehicle.is_rolled_out;
  session.tracker = vehicle.tracker.state();
}

HttpResponse answer_next(const Context& context, const HttpRequest& request,
                         const SealedScope& scope) {
  const bool in_set = scope.set.has_value();
  ScanInBody found = find_session_scan(request, context.options,
                                       in_set ? ScanPurpose::kSetSealed : ScanPurpose::kSealed);
  SealedStart start =
      start_of(context, request, scope, {found.parameters.prior, found.parameters.gnss});
  SealedSession& session = start.session;
  const PoseForms forms = pose_forms(request, start.map);
  check_place(start, found.parameters);
  const bool is_placed = found.parameters.prior || found.parameters.gnss;
  SetVehicle vehicle = vehicle_of(start, found.parameters);
  const std::string before = vehicle.map.map;
  const std::string now = require_rollout(context, before, session);
  vehicle.is_rolled_out = session.is_rolled_out;
  if (in_set) start.set = maps_like(std::move(start.set), vehicle.map);
  PoseAnswer answer = answer_for(start.map, request);
  answer.vehicle = session.vehicle;
  answer.version_was_named = session.version_was_named;
  const PoseClock::time_point deadline = deadline_of(context, request, found.parameters.deadline);
  {
    const WorkKind kind = start.is_new && !is_placed ? WorkKind::kEverywhere : WorkKind::kNearPrior;
    AlignmentQueue::Ticket ticket =
        context.queue.enter(reservation_of(request), {.kind = kind, .deadline = deadline});
    track_session_scan(
        context, request, std::move(found),
        {.thin = [&](const localization::ScanView& all) { return vehicle.tracker.thin(all); },
         .track =
             [&](const ScanInSet& scan) {
               SetTrackedPose tracked = track_in_set(vehicle, start.set, scan);
               set_map(answer, start.set, vehicle.map);
               return tracked;
             },
         .deadline = deadline},
        ticket, answer);
  }
  check_deadline(deadline);
  answer.session = hex_of(session.id);
  note(session, vehicle, in_set);
  if (vehicle.map.map == before && now != session.version) answer.other_version = now;
  const std::string next =
      context.seals.next(std::move(session), owner_of(request, scope), answer.is_replay);
  context.metrics.sealed_scan(start.is_new ? "begun" : answer.is_replay ? "replayed" : "continued");
  count_answer(context, answer, answer.parameters.method);
  note_clock_skew(context, answer);
  finish_answer(context, request, answer);
  HttpResponse response = pose_response(answer, forms, vehicle.map);
  response.headers.emplace_back(kSealHeader, next);
  if (!in_set) add_revision(response, start.map);
  return response;
}

}  // namespace

void add_sealed_session_routes(std::vector<Route>& routes, const Context& context) {
  const auto reserve = [&context](const HttpRequest& request, const PathParameters& path) {
    const SealedScope scope = scope_of(context, request, path);
    // A seal that cannot be used is refused before its scan is read.
    if (!request.header("stillmap-seal").empty())
      (void)context.seals.open(request.header("stillmap-seal"), owner_of(request, scope));
    else if (scope.set)
      return reserve_room(context, request, kind_in_head(request),
                          units_in(*scope.set, kind_in_head(request)));
    else
      require_ready(context, request, path);
    return reserve_room(context, request, WorkKind::kNearPrior, 1);
  };
  for (const char* pattern :
       {"/v1/maps/{map}/localize/next", "/v1/maps/{map}/versions/{version}/localize/next"}) {
    Route route{"POST", pattern,
                [&context](const HttpRequest& request, const PathParameters& path) {
                  return counting_refusals(context, path.at("map"), [&] {
                    return answer_next(context, request, scope_of(context, request, path));
                  });
                },
                Access::kLocalize, BodyKind::kWhole};
    route.reserve = [&context, reserve](const HttpRequest& request, const PathParameters& path) {
      return counting_refusals(context, path.at("map"), [&] { return reserve(request, path); });
    };
    routes.push_back(std::move(route));
  }
  Route in_set{"POST", "/v1/localize/next",
               [&context](const HttpRequest& request, const PathParameters& path) {
                 return answer_next(context, request, scope_of(context, request, path));
               },
               Access::kLocalize, BodyKind::kWhole};
  in_set.reserve = reserve;
  in_set.limits_maps = true;
  routes.push_back(std::move(in_set));
}

}  // namespace stillmap::server
