#include "bodies/pose_request_json.hpp"
#include "bodies/session_json.hpp"
#include "errors/api_error.hpp"
#include "handlers/session_scan.hpp"
#include "page_query.hpp"
#include "pose_response.hpp"
#include "security/map_limits.hpp"

#include <fmt/format.h>

#include <map>
#include <optional>
#include <string>
#include <utility>

namespace stillmap::server {
namespace {

/// A place to start from, and not much more.
constexpr std::uint64_t kMostSessionJson = std::uint64_t{64} << 10U;

/// Events of one session on their way to one client.
class SessionStream final : public EventSource {
 public:
  SessionStream(std::shared_ptr<Session> session, const MapCatalog& catalog, std::uint64_t last_id)
      : session_(std::move(session)), catalog_(catalog), last_id_(last_id) {}

  std::optional<std::string> next(std::chrono::milliseconds most) override {
    if (ended_) return std::nullopt;
    note_version(*session_, catalog_);
    const SessionEvents::Read read = session_->events().after(last_id_, most);
    if (!read.events.empty()) last_id_ = read.events.back().id;
    ended_ = read.closed;
    return to_stream(read);
  }

  /// A session that is told of its map's new version whenever somebody looks needs no listener in
  /// the catalogue.
  static void note_version(Session& session, const MapCatalog& catalog) {
    const std::string vehicle = session.version_was_named() ? "" : session.vehicle();
    const std::string map = session.map().map;
    if (const auto version = version_now(catalog, map, vehicle))
      session.note_active_version(map, *version);
  }

 private:
  std::shared_ptr<Session> session_;
  const MapCatalog& catalog_;
  std::uint64_t last_id_;
  bool ended_ = false;
};

std::shared_ptr<Session> find_session(const Context& context, const HttpRequest& request,
                                      const PathParameters& path) {
  return context.sessions.find(path.at("session"), request.caller.key_id);
}

HttpResponse opened(const Context& context, const Session& session) {
  HttpResponse response = json_response(session_json(session, context.sessions.limits().idle), 201);
  response.headers.emplace_back("Location", "/v1/sessions/" + session.id());
  if (session.set().empty()) add_revision(response, session.map());
  return response;
}

/// In the map of the set that is nearest to its place; its first scan may find it in another one.
HttpResponse open_in_set(const Context& context, const HttpRequest& request,
                         const SessionRequest& wanted) {
  const SetOfRequest set =
      maps_of(context, wanted_set(context, request.caller, wanted.set), wanted.label);
  const PlaceInSet place{wanted.prior, wanted.gnss};
  const SetMap& first = *candidates_in(set, place).maps.front().in;
  context.vehicles.seen(first.map.map, wanted.label, first.map.version, {}, unix_ns());
  const std::shared_ptr<Session> session =
      context.sessions.open(first.map, {.owner = request.caller.key_id,
                                        .label = wanted.label,
                                        .is_rolled_out = first.is_rolled_out,
                                        .set = set.name});
  session->initialize(place);
  return opened(context, *session);
}

HttpResponse open_session(const Context& context, const HttpRequest& request) {
  require_json_if_any(request);
  const SessionRequest wanted = read_session_json(request.body, true, context.options);
  if (wanted.map.empty()) return open_in_set(context, request, wanted);
  require_map(request.caller, wanted.map);
  const bool is_named = !wanted.version.empty();
  ServedVersion map = context.catalog.ready(
      wanted.map, is_named ? std::optional<std::string_view>(wanted.version) : std::nullopt,
      wanted.label, seen_revision(request));
  const bool came_with_rollout = !is_named && is_rolled_out(context.catalog, map);
  context.vehicles.seen(map.map, wanted.label, map.version, {}, unix_ns());
  const auto prior = prior_in(map, wanted.prior, wanted.gnss);
  const std::shared_ptr<Session> session =
      context.sessions.open(std::move(map), {.owner = request.caller.key_id,
                                             .label = wanted.label,
                                             .version_was_named = is_named,
                                             .is_rolled_out = came_with_rollout});
  if (prior) session->initialize({.prior = prior, .gnss = {}});
  return opened(context, *session);
}

/// Of a session in a set those that it may go on in, which are none when the set is gone.
SetOfRequest maps_of(const Context& context, const Session& session, const Caller& caller) {
  if (!session.set().empty())
    for (const MapSet& set : seen_sets(context, caller))
      if (set.name == session.set())
        return maps_like(maps_of(context, set, session.vehicle()), session.map());
  return {};
}

HttpResponse initialize_session(const Context& context, const HttpRequest& request,
                                const PathParameters& path) {
  require_json_if_any(request);
  const std::shared_ptr<Session> session = find_session(context, request, path);
  const SessionRequest wanted = read_session_json(request.body, false, context.options);
  if (session->set().empty())
    session->initialize({.prior = prior_in(session->map(), wanted.prior, wanted.gnss), .gnss = {}});
  else
    session->initialize({.prior = wanted.prior, .gnss = wanted.gnss});
  return json_response(session_json(*session, context.sessions.limits().idle));
}

/// @throws ApiError kUnknownSession when the session ended while its scan waited.
AlignmentQueue::Ticket enter(const Context& context, const HttpRequest& request,
                             SessionLine::Scan& scan) {
  try {
    return context.queue.enter(reservation_of(request), scan.work(WorkKind::kNearPrior));
  } catch (const ApiError&) {
    scan.require_place();
    throw;
  }
}

/// Else a vehicle would stay in a version that was halted, or that nobody trusts any more, as long
/// as it drives.
void require_version(const Context& context, const std::shared_ptr<Session>& session) {
  const ServedVersion served = session->map();
  const std::string& map = served.map;
  if (const std::string why = context.catalog.distrust_of(map, served.version); !why.empty())
    throw ApiError(ErrorCode::kNotSigned, why);
  const auto version = version_now(context.catalog, map, session->vehicle());
  const auto active = version_now(context.catalog, map, {});
  if (!version || !active || !session->lost_its_version(map, *version, *active)) return;
  context.sessions.close(session->id(), session->owner(), "rolled_back");
  throw ApiError(ErrorCode::kUnknownSession,
                 "the roll-out of version '" + served.version + "' of map '" + map +
                     "' has ended for this vehicle, and the session with it: open another one");
}

HttpResponse track_scan(const Context& context, const HttpRequest& request,
                        const std::shared_ptr<Session>& session) {
  require_version(context, session);
  SessionStream::note_version(*session, context.catalog);
  const PoseForms forms = pose_forms(request, session->map());
  ScanInBody found = find_session_scan(request, context.options, ScanPurpose::kSession);
  const std::int64_t stamp_ns = *found.parameters.stamp_ns;
  const PoseClock::time_point deadline = deadline_of(context, request, found.parameters.deadline);
  ServedVersion map = session->map();
  const SetOfRequest set = maps_of(context, *session, request.caller);
  PoseAnswer answer = answer_for(map, request);
  answer.vehicle = session->vehicle();
  answer.version_was_named = session->version_was_named();
  {
    SessionLine::Scan scan(session->line(), stamp_ns, deadline);
    scan.wait_for_turn();
    AlignmentQueue::Ticket ticket = enter(context, request, scan);
    scan.begin();
    track_session_scan(
        context, request, std::move(found),
        {.thin = [&](const localization::ScanView& all) { return session->thin(all); },
         .track =
             [&](const ScanInSet& tracked_scan) {
               Session::Tracked tracked = session->track(set, tracked_scan);
               map = tracked.map;
               set_map(answer, set, map);
               return tracked.pose;
             },
         .deadline = deadline},
        ticket, answer);
  }
  check_deadline(deadline);
  session->touch(PoseClock::now());
  answer.session = session->id();
  count_answer(context, answer, answer.parameters.method);
  note_clock_skew(context, answer);
  finish_answer(context, request, answer);
  return pose_response(answer, forms, map);
}

HttpResponse stream_events(const Context& context, const HttpRequest& request,
                           const PathParameters& path) {
  const std::shared_ptr<Session> session = find_session(context, request, path);
  HttpResponse response;
  response.events = std::make_shared<SessionStream>(session, context.catalog,
                                                    last_event_id(request.header("last-event-id")));
  return response;
}

HttpResponse show_session(const Context& context, const HttpRequest& request,
                          const PathParameters& path) {
  const std::shared_ptr<Session> session = find_session(context, request, path);
  SessionStream::note_version(*session, context.catalog);
  return json_response(session_json(*session, context.sessions.limits().idle));
}

/// Whoever opened them sees their own; operators see where all vehicles are.
HttpResponse list_sessions(const Context& context, const HttpRequest& request) {
  const std::map<std::string, std::string> query = read_query(request, {"map"});
  const Caller& caller = request.caller;
  SessionList list{.caller = caller.key_id};
  list.sessions = context.sessions.list(
      caller.is_admin ? std::nullopt : std::optional<std::string>(caller.key_id));
  if (const auto map = query.find("map"); map != query.end())
    std::erase_if(list.sessions,
                  [&](const auto& session) { return session->map().map != map->second; });
  for (const ApiKey& key : context.store.keys().list()) list.key_names[key.id] = key.name;
  return json_response(session_list_json(list, context.sessions.limits().idle));
}

void add_scan_route(std::vector<Route>& routes, const Context& context) {
  Route scans{"POST", "/v1/sessions/{session}/scans",
              [&context](const HttpRequest& request, const PathParameters& path) {
                const std::shared_ptr<Session> session = find_session(context, request, path);
                try {
                  return counting_refusals(context, session->map().map,
                                           [&] { return track_scan(context, request, session); });
                } catch (const ApiError& error) {
                  if (error.code() == ErrorCode::kSuperseded) context.metrics.scan_superseded();
                  throw;
                }
              },
              Access::kLocalize, BodyKind::kWhole};
  scans.reserve = [&context](const HttpRequest& request, const PathParameters& path) {
    const std::shared_ptr<Session> session = find_session(context, request, path);
    return counting_refusals(context, session->map().map, [&] {
      return reserve_room(context, request, WorkKind::kNearPrior, 1);
    });
  };
  routes.push_back(std::move(scans));
}

}  // namespace

void add_session_routes(std::vector<Route>& routes, const Context& context) {
  const auto add = [&](const char* method, const char* pattern, BodyKind body, const auto& answer) {
    routes.push_back({method, pattern,
                      [&context, answer](const HttpRequest& request, const PathParameters& path) {
                        return answer(context, request, path);
                      },
                      Access::kLocalize, body, kMostSessionJson});
    // A session is found only by the key that opened it, on a map that this key may use.
    routes.back().limits_maps = true;
  };
  add("POST", "/v1/sessions", BodyKind::kWhole,
      [](const Context& in, const HttpRequest& request, const PathParameters&) {
        return open_session(in, request);
      });
  routes.push_back({"GET", "/v1/sessions",
                    [&context](const HttpRequest& request, const PathParameters&) {
                      return list_sessions(context, request);
                    },
                    Access::kLocalizeOrAdmin});
  routes.back().limits_maps = true;
  add("GET", "/v1/sessions/{session}", BodyKind::kNone, show_session);
  add("DELETE", "/v1/sessions/{session}", BodyKind::kNone,
      [](const Context& in, const HttpRequest& request, const PathParameters& path) {
        in.sessions.close(path.at("session"), request.caller.key_id);
        return HttpResponse{.status = 204, .content_type = "", .body = "", .headers = {}};
      });
  add("POST", "/v1/sessions/{session}/initialize", BodyKind::kWhole, initialize_session);
  add("GET", "/v1/sessions/{session}/events", BodyKind::kNone, stream_events);
  add_scan_route(routes, context);
}

}  // namespace stillmap::server
