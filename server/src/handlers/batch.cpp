#include "bodies/answers_json.hpp"
#include "bodies/pose_request_json.hpp"
#include "errors/api_error.hpp"
#include "handlers/flat_parameters.hpp"
#include "handlers/scan_in_request.hpp"
#include "http/header_text.hpp"
#include "http/multipart.hpp"
#include "json/problem_json.hpp"
#include "pose/pose_checks.hpp"
#include "pose_handling.hpp"
#include "pose_response.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <utility>

namespace stillmap::server {
namespace {

/// A scan of usual size, to tell from a body's length how many it may hold.
constexpr std::size_t kUsualScanBytes = std::size_t{2} << 20U;

/// A batch on its way: what was asked, where the scans are, what was answered.
struct Batch {
  JsonBatch queries;
  /// One a query; without a scan the query is refused. Empty when the scans are in the JSON.
  std::vector<std::optional<ScanInBody>> scans;
  std::vector<BatchedAnswer> answers;
};

/// @throws ApiError for a part that belongs to no query.
std::size_t scan_number(const std::string& name, std::size_t queries) {
  constexpr std::string_view kPrefix = "scan-";
  if (name.starts_with(kPrefix)) {
    const std::int64_t number = read_integer(name, std::string_view(name).substr(kPrefix.size()));
    if (number >= 0 && static_cast<std::size_t>(number) < queries) {
      return static_cast<std::size_t>(number);
    }
  }
  throw field_error(ErrorCode::kUnknownParameter, "multipart body", "part '" + name + "'",
                    fmt::format("'request' and 'scan-0' to 'scan-{}'", queries - 1));
}

/// The part `request` is in front. @throws ApiError.
std::vector<MultipartPart> split_batch(const ServerOptions& options, const HttpRequest& request) {
  const auto most_parts = static_cast<std::size_t>(options.batch.max_scans) + 1;
  std::vector<MultipartPart> parts =
      split_multipart(request.header("content-type"), request.body, most_parts);
  if (parts.empty() || parts.front().name != "request") {
    throw field_error(ErrorCode::kInvalidRequest, "multipart body", "no part 'request' in front",
                      "it first");
  }
  return parts;
}

Batch read_multipart(const ServerOptions& options, const std::vector<MultipartPart>& parts) {
  Batch batch;
  batch.queries = read_batch_json(parts.front().content, JsonScan::kRawBeside, options);
  batch.scans.resize(batch.queries.items.size());
  for (std::size_t i = 1; i < parts.size(); ++i) {
    std::optional<ScanInBody>& scan = batch.scans[scan_number(parts[i].name, batch.scans.size())];
    if (scan) throw field_error(ErrorCode::kInvalidRequest, parts[i].name, "it twice", "it once");
    scan = ScanInBody{.kind = scan_kind_of(parts[i].name, parts[i].content_type),
                      .bytes = parts[i].content,
                      .parameters = {}};
  }
  return batch;
}

PoseRequest take_query(const Context& context, Batch& batch, std::size_t i) {
  JsonBatch::Item& item = batch.queries.items[i];
  if (item.error) throw ApiError(*item.error);
  if (batch.scans.empty()) {
    PoseRequest request{std::move(item.request.parameters), std::move(item.request.scan_lidar)};
    check_scan(request, context.options);
    return request;
  }
  if (!batch.scans[i]) {
    throw field_error(ErrorCode::kInvalidRequest, fmt::format("scan-{}", i), "no such part", "one");
  }
  batch.scans[i]->parameters = std::move(item.request.parameters);
  return decode_scan(std::move(*batch.scans[i]), context.options);
}

/// A batch whose turn has come.
struct BatchTurn {
  const HttpRequest& request;
  const PathParameters& path;
  const ServedVersion& map;
  PoseClock::time_point deadline;
  AlignmentQueue::Ticket& ticket;
};

std::string answer_query(const Context& context, const BatchTurn& turn, Batch& batch,
                         std::size_t i) {
  PoseAnswer answer = answer_for(turn.map, turn.request, turn.path);
  const PoseClock::time_point begin = PoseClock::now();
  PoseRequest query = take_query(context, batch, i);
  answer.timing.decode_ms = milliseconds_since(begin);
  PoseParameters& parameters = query.parameters;
  const localization::Aligner& aligner = choose_aligner(*turn.map.aligners, parameters.method);
  parameters.prior = prior_in(turn.map, parameters.prior, parameters.gnss);
  const PoseClock::time_point aligning = PoseClock::now();
  const localization::ThinScan scan = scan_to_match(
      query, [&](const localization::ScanView& all) { return aligner.thin(all); }, answer);
  answer.result = aligner.align_thin(scan, parameters.prior);
  answer.timing.align_ms = milliseconds_since(aligning);
  answer.parameters = std::move(parameters);
  turn.ticket.scan_done(kind_of(answer.parameters));
  count_answer(context, answer, answer.parameters.method);
  note_clock_skew(context, answer);
  finish_answer(context, turn.request, answer);
  return pose_answer_json(answer);
}

/// Each query is answered or refused on its own; past the deadline the rest is refused.
void answer_queries(const Context& context, const BatchTurn& turn, Batch& batch) {
  for (std::size_t i = 0; i < batch.queries.items.size(); ++i) {
    require_client(turn.request);
    try {
      batch.answers.push_back({200, counting_refusals(context, turn.map.map, [&] {
                                 if (i > 0) turn.ticket.give_way();
                                 check_deadline(turn.deadline);
                                 return answer_query(context, turn, batch, i);
                               })});
    } catch (const ApiError& error) {
      batch.answers.push_back(
          {info_of(error.code()).http_status, problem_json(error, turn.request.request_id)});
    }
  }
}

HttpResponse answer_batch(const Context& context, const HttpRequest& request,
                          const PathParameters& path) {
  const ServedVersion map = ready_version(context, request, path);
  require_json_taken(request);
  const std::string type = media_type(request.header("content-type"));
  const bool is_json = type == "application/json";
  if (!is_json && type != "multipart/form-data") {
    throw field_error(ErrorCode::kUnsupportedMediaType, "Content-Type", "'" + type + "'",
                      "application/json or multipart/form-data");
  }
  require_vehicle_alone(request.query, fmt::format("'{}' alone", kVehicleParameter));
  const std::shared_ptr<const ServerOptions> options = context.live.current();
  const std::vector<MultipartPart> parts =
      is_json ? std::vector<MultipartPart>{} : split_batch(*options, request);
  Batch batch;
  // JSON with points in it is work, and any long one takes memory: it waits for a worker, although
  // it may hold more scans and another deadline than is known then.
  const bool early = !is_json && parts.front().content.size() <= kMostQueryJson;
  if (early) batch = read_multipart(*options, parts);
  const AlignmentQueue::Work work{
      .units = std::max(1, static_cast<int>(parts.size()) - 1),
      .deadline = deadline_of(context, request, batch.queries.deadline)};
  {
    AlignmentQueue::Ticket ticket = context.queue.enter(reservation_of(request), work);
    context.metrics.queue_waited(1e-3 * milliseconds_since(request.received));
    if (is_json) {
      batch.queries = read_batch_json(request.body, JsonScan::kInside, *options,
                                      [&] { require_wanted(request, work.deadline); });
    } else if (!early) {
      batch = read_multipart(*options, parts);
    }
    const PoseClock::time_point deadline = deadline_of(context, request, batch.queries.deadline);
    ticket.set_deadline(deadline);
    answer_queries(context, {request, path, map, deadline, ticket}, batch);
  }
  HttpResponse response = json_response(batch_answer_json(batch.answers, request.request_id));
  add_revision(response, map);
  return response;
}

}  // namespace

void add_batch_routes(std::vector<Route>& routes, const Context& context) {
  for (const char* pattern :
       {"/v1/maps/{map}/localize/batch", "/v1/maps/{map}/versions/{version}/localize/batch"}) {
    Route route{"POST", pattern,
                [&context](const HttpRequest& request, const PathParameters& path) {
                  return answer_batch(context, request, path);
                },
                Access::kLocalize, BodyKind::kWhole};
    route.reserve = [&context](const HttpRequest& request, const PathParameters& path) {
      return counting_refusals(context, path.at("map"), [&] {
        require_ready(context, request, path);
        const auto scans = static_cast<int>(1 + body_bytes(context, request) / kUsualScanBytes);
        return reserve_room(context, request, WorkKind::kNearPrior,
                            std::min(scans, context.live.current()->batch.max_scans));
      });
    };
    routes.push_back(std::move(route));
  }
}

}  // namespace stillmap::server
