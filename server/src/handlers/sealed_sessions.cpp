#include "errors/api_error.hpp"
#include "handlers/flat_parameters.hpp"
#include "handlers/session_scan.hpp"
#include "pose_response.hpp"
#include "sealing/session_seals.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include "store/store_refusal.hpp"

#include <string>
#include <utility>

/// Sessions whose state travels with the vehicle: any server of the store goes on with any of them.
namespace stillmap::server {
namespace {

constexpr const char* kSealHeader = "Stillmap-Seal";

SealOwner owner_of(const HttpRequest& request, const PathParameters& path) {
  return {.key_id = request.caller.key_id, .map = path.at("map")};
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

/// @throws ApiError for a seal that nothing goes on from, and as `MapCatalog::ready`.
SealedStart start_of(const Context& context, const HttpRequest& request,
                     const PathParameters& path) {
  const std::string text = request.header("stillmap-seal");
  const std::string& map = path.at("map");
  SealedStart start;
  if (text.empty()) {
    start.map = ready_version(context, request, path);
    start.session = context.seals.begin();
    start.session.version = start.map.version;
    start.session.digest = start.map.package->digest();
    start.session.vehicle = read_vehicle(request.query);
    start.session.version_was_named = version_in(path).has_value();
    start.session.is_rolled_out =
        !start.session.version_was_named && is_rolled_out(context.catalog, start.map);
    return start;
  }
  start.is_new = false;
  start.session = context.seals.open(text, owner_of(request, path));
  require_same(request, path, start.session);
  if (const std::string why = context.catalog.distrust_of(map, start.session.version); !why.empty())
    throw ApiError(ErrorCode::kNotSigned, why);
  start.map = sealed_version(context, map, start.session);
  return start;
}

/// The place to begin at. @throws ApiError for one that a session cannot begin at.
std::optional<localization::Prior> prior_of(const SealedStart& start,
                                            const PoseParameters& parameters) {
  if (!start.is_new && (parameters.prior || parameters.gnss))
    throw field_error(ErrorCode::kInvalidRequest, parameters.prior ? "prior" : "gnss",
                      "a place beside a seal", "one of the two: leave out the seal to begin anew");
  if (parameters.prior && !parameters.prior->covariance)
    throw field_error(
        ErrorCode::kInvalidPrior, "prior.covariance", "nothing",
        "36 numbers, or prior_sigma: a session weighs the prior against what follows");
  return prior_in(start.map, parameters.prior, parameters.gnss);
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

HttpResponse answer_next(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  SealedStart start = start_of(context, request, path);
  const ServedVersion& map = start.map;
  SealedSession& session = start.session;
  const PoseForms forms = pose_forms(request, map);
  ScanInBody found = find_session_scan(request, context.options, ScanPurpose::kSealed);
  const auto prior = prior_of(start, found.parameters);
  found.parameters.prior = prior;
  localization::Tracker tracker = tracker_of(start);
  require_newer(tracker, *found.parameters.stamp_ns);
  if (prior) tracker.initialize(prior->T_map_lidar, prior->covariance.value());
  PoseAnswer answer = answer_for(map, request);
  const std::string now = require_rollout(context, map.map, session);
  if (now != session.version) answer.other_version = now;
  answer.vehicle = session.vehicle;
  answer.version_was_named = session.version_was_named;
  const PoseClock::time_point deadline = deadline_of(context, request, found.parameters.deadline);
  {
    const WorkKind kind = start.is_new && !prior ? WorkKind::kEverywhere : WorkKind::kNearPrior;
    AlignmentQueue::Ticket ticket =
        context.queue.enter(reservation_of(request), {.kind = kind, .deadline = deadline});
    track_session_scan(
        context, request, std::move(found),
        {.thin = [&](const localization::ScanView& all) { return tracker.thin(all); },
         .track =
             [&](std::int64_t stamp_ns, const localization::ThinScan& scan, const auto& odometry) {
               return tracker.track_thin(stamp_ns, scan, odometry);
             },
         .deadline = deadline},
        ticket, answer);
  }
  check_deadline(deadline);
  answer.session = hex_of(session.id);
  session.tracker = tracker.state();
  const std::string next =
      context.seals.next(std::move(session), owner_of(request, path), answer.is_replay);
  context.metrics.sealed_scan(start.is_new ? "begun" : answer.is_replay ? "replayed" : "continued");
  count_answer(context, answer, answer.parameters.method);
  note_clock_skew(context, answer);
  finish_answer(context, request, answer);
  HttpResponse response = pose_response(answer, forms, map);
  response.headers.emplace_back(kSealHeader, next);
  add_revision(response, map);
  return response;
}

}  // namespace

void add_sealed_session_routes(std::vector<Route>& routes, const Context& context) {
  for (const char* pattern :
       {"/v1/maps/{map}/localize/next", "/v1/maps/{map}/versions/{version}/localize/next"}) {
    Route route{"POST", pattern,
                [&context](const HttpRequest& request, const PathParameters& path) {
                  return counting_refusals(context, path.at("map"),
                                           [&] { return answer_next(context, request, path); });
                },
                Access::kLocalize, BodyKind::kWhole};
    route.reserve = [&context](const HttpRequest& request, const PathParameters& path) {
      return counting_refusals(context, path.at("map"), [&] {
        // A seal that cannot be used is refused before its scan is read.
        if (request.header("stillmap-seal").empty())
          require_ready(context, request, path);
        else
          (void)context.seals.open(request.header("stillmap-seal"), owner_of(request, path));
        return reserve_room(context, request, WorkKind::kNearPrior, 1);
      });
    };
    routes.push_back(std::move(route));
  }
}

}  // namespace stillmap::server
