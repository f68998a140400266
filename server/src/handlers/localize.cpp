#include "errors/api_error.hpp"
#include "handlers/flat_parameters.hpp"
#include "handlers/scan_in_request.hpp"
#include "handlers/set_maps.hpp"
#include "pose_handling.hpp"
#include "pose_response.hpp"

#include <algorithm>
#include <functional>
#include <string_view>
#include <utility>

namespace stillmap::server {
namespace {

void align(const Context& context, const ServedVersion& map, PoseRequest& request,
           PoseAnswer& answer) {
  PoseParameters& parameters = request.parameters;
  const localization::Aligner& aligner = choose_aligner(*map.aligners, parameters.method);
  parameters.prior = prior_in(map, parameters.prior, parameters.gnss);
  const PoseClock::time_point begin = PoseClock::now();
  const localization::ThinScan scan = scan_to_match(
      request, [&](const localization::ScanView& all) { return aligner.thin(all); }, answer);
  answer.result = aligner.align_thin(scan, parameters.prior);
  answer.timing.align_ms = milliseconds_since(begin);
  answer.parameters = std::move(parameters);
  count_answer(context, answer, answer.parameters.method);
  note_clock_skew(context, answer);
}

HttpResponse answer_localize(const Context& context, const HttpRequest& request,
                             const PathParameters& path) {
  const ServedVersion map = ready_version(context, request, path);
  const PoseForms forms = pose_forms(request, map);
  ScanInBody found = find_scan(request, context.options, ScanPurpose::kQuery);
  // What can be refused is refused before it waits.
  static_cast<void>(choose_aligner(*map.aligners, found.parameters.method));
  PoseClock::time_point deadline = deadline_of(context, request, found.parameters.deadline);
  PoseAnswer answer = answer_for(map, request, path);
  {
    const WorkKind kind =
        found.kind == ScanInBody::Kind::kJson ? WorkKind::kNearPrior : kind_of(found.parameters);
    AlignmentQueue::Ticket ticket =
        context.queue.enter(reservation_of(request), {.kind = kind, .deadline = deadline});
    answer.timing.wait_ms = milliseconds_since(request.received);
    context.metrics.queue_waited(1e-3 * answer.timing.wait_ms);
    const PoseClock::time_point begin = PoseClock::now();
    const auto wanted = [&] { require_wanted(request, deadline); };
    wanted();
    PoseRequest pose_request = decode_scan(std::move(found), context.options, wanted);
    answer.timing.decode_ms = milliseconds_since(begin);
    deadline = deadline_of(context, request, pose_request.parameters.deadline);
    wanted();
    align(context, map, pose_request, answer);
    ticket.scan_done(kind_of(answer.parameters));
  }
  check_deadline(deadline);
  finish_answer(context, request, answer);
  HttpResponse response = pose_response(answer, forms, map);
  add_revision(response, map);
  return response;
}

/// What a set's maps are asked, one after the other.
void align_in_set(const Context& context, const SetOfRequest& set, const SetCandidates& candidates,
                  PoseRequest& request, AlignmentQueue::Ticket& ticket, PoseAnswer& answer,
                  const std::function<void()>& wanted) {
  PoseParameters& parameters = request.parameters;
  const auto aligner_in = [&](const SetMap& map) -> const localization::Aligner& {
    return choose_aligner(*map.map.aligners, parameters.method);
  };
  const localization::Aligner& first = aligner_in(*candidates.maps.front().in);
  const PoseClock::time_point begin = PoseClock::now();
  const localization::ThinScan scan = scan_to_match(
      request, [&](const localization::ScanView& all) { return first.thin(all); }, answer);
  FoundInSet found = search_in(candidates, [&](const SetCandidates::Each& each) {
    wanted();
    localization::AlignmentResult result = aligner_in(*each.in).align_thin(scan, each.prior);
    ticket.scan_done(kind_of(parameters));
    return result;
  });
  const SetCandidates::Each& in = candidates.maps[found.candidate];
  set_map(answer, set, in.in->map);
  answer.result = std::move(found.result);
  answer.timing.align_ms = milliseconds_since(begin);
  context.metrics.set_map_chosen(answer.map_name, name_of({parameters.prior, parameters.gnss}));
  parameters.prior = in.prior;
  answer.parameters = std::move(parameters);
}

/// As `answer_localize`, in the map of a set that the scan is in.
HttpResponse answer_localize_in_set(const Context& context, const HttpRequest& request) {
  const std::string name = read_set(request.query);
  const std::string vehicle = read_vehicle(request.query);
  ScanInBody found = find_scan(request, context.options, ScanPurpose::kSetQuery);
  PoseClock::time_point deadline = deadline_of(context, request, found.parameters.deadline);
  PoseAnswer answer;
  answer.request_id = request.request_id;
  answer.vehicle = vehicle;
  PoseForms forms;
  SetOfRequest set;
  const SetMap* in = nullptr;
  {
    const WorkKind kind =
        found.kind == ScanInBody::Kind::kJson ? WorkKind::kNearPrior : kind_of(found.parameters);
    AlignmentQueue::Ticket ticket =
        context.queue.enter(reservation_of(request), {.kind = kind, .deadline = deadline});
    answer.timing.wait_ms = milliseconds_since(request.received);
    context.metrics.queue_waited(1e-3 * answer.timing.wait_ms);
    const PoseClock::time_point begin = PoseClock::now();
    const std::function<void()> wanted = [&] { require_wanted(request, deadline); };
    wanted();
    PoseRequest pose_request = decode_scan(std::move(found), context.options, wanted);
    answer.timing.decode_ms = milliseconds_since(begin);
    deadline = deadline_of(context, request, pose_request.parameters.deadline);
    const PlaceInSet place{pose_request.parameters.prior, pose_request.parameters.gnss};
    set = maps_of(context, wanted_set(context, request.caller, name, place.gnss.has_value()),
                  vehicle);
    // All that are asked take one thinned scan.
    set = maps_like(set, candidates_in(set, place).maps.front().in->map);
    const SetCandidates candidates = candidates_in(set, place);
    forms = pose_forms(request, candidates.maps.front().in->map);
    align_in_set(context, set, candidates, pose_request, ticket, answer, wanted);
  }
  check_deadline(deadline);
  count_answer(context, answer, answer.parameters.method);
  note_clock_skew(context, answer);
  finish_answer(context, request, answer);
  for (const SetMap& each : set.maps)
    if (each.map.map == answer.map_name) in = &each;
  return pose_response(answer, forms, in->map);
}

}  // namespace

void add_localize_routes(std::vector<Route>& routes, const Context& context) {
  for (const char* pattern :
       {"/v1/maps/{map}/localize", "/v1/maps/{map}/versions/{version}/localize"}) {
    Route route{"POST", pattern,
                [&context](const HttpRequest& request, const PathParameters& path) {
                  return counting_refusals(context, path.at("map"),
                                           [&] { return answer_localize(context, request, path); });
                },
                Access::kLocalize, BodyKind::kWhole};
    route.reserve = [&context](const HttpRequest& request, const PathParameters& path) {
      return counting_refusals(context, path.at("map"), [&] {
        require_ready(context, request, path);
        return reserve_room(context, request, kind_in_head(request), 1);
      });
    };
    routes.push_back(std::move(route));
  }
  Route in_set{"POST", "/v1/localize",
               [&context](const HttpRequest& request, const PathParameters&) {
                 return answer_localize_in_set(context, request);
               },
               Access::kLocalize, BodyKind::kWhole};
  in_set.limits_maps = true;
  in_set.reserve = [&context](const HttpRequest& request, const PathParameters&) {
    const std::string name = read_set(request.query);
    const WorkKind kind = kind_in_head(request);
    // Without a name a fix in the body may do.
    const int units = name.empty() ? 1 : units_in(wanted_set(context, request.caller, name), kind);
    return reserve_room(context, request, kind, units);
  };
  routes.push_back(std::move(in_set));
}

}  // namespace stillmap::server
