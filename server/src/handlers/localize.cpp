#include "errors/api_error.hpp"
#include "handlers/scan_in_request.hpp"
#include "pose_handling.hpp"
#include "pose_response.hpp"

#include <algorithm>
#include <string_view>
#include <utility>

namespace stillmap::server {
namespace {

/// As far as the head tells it: parameters in a body are taken for the usual ones.
WorkKind kind_in_head(const HttpRequest& request) {
  const auto has = [&](std::string_view name) {
    return std::any_of(request.query.begin(), request.query.end(),
                       [&](const auto& each) { return each.first == name; });
  };
  const auto method = std::find_if(request.query.begin(), request.query.end(),
                                   [](const auto& each) { return each.first == "method"; });
  if (method != request.query.end() && is_reference(method->second)) return WorkKind::kReference;
  const bool flat = request.header("content-type").starts_with("application/octet-stream") ||
                    request.header("content-type").starts_with("application/vnd.pcd");
  return flat && !has("prior_t") && !has("gnss") ? WorkKind::kEverywhere : WorkKind::kNearPrior;
}

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
}

}  // namespace stillmap::server
