#include "pose_handling.hpp"

#include "errors/api_error.hpp"
#include "errors/refusal_codes.hpp"
#include "handlers/flat_parameters.hpp"
#include "http/header_text.hpp"
#include "pose/clock_skew.hpp"

#include <stillmap/localization/movable.hpp>

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <charconv>
#include <exception>
#include <utility>
#include <vector>

namespace stillmap::server {

double milliseconds_since(PoseClock::time_point begin) {
  return std::chrono::duration<double, std::milli>(PoseClock::now() - begin).count();
}

std::int64_t seen_revision(const HttpRequest& request) {
  const std::string text = request.header("stillmap-revision");
  if (text.empty()) return 0;
  std::int64_t revision = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), revision);
  if (error != std::errc() || end != text.data() + text.size() || revision < 0)
    throw field_error(ErrorCode::kInvalidRequest, kRevisionHeader, "'" + text + "'",
                      "a whole number, as an answer about this map had it, or no such header");
  return revision;
}

ServedVersion ready_version(const Context& context, const HttpRequest& request,
                            const PathParameters& path) {
  return context.catalog.ready(path.at("map"), version_in(path), read_vehicle(request.query),
                               seen_revision(request));
}

void add_revision(HttpResponse& response, const ServedVersion& map) {
  if (map.revision > 0)
    response.headers.emplace_back(kRevisionHeader, std::to_string(map.revision));
}

void require_ready(const Context& context, const HttpRequest& request, const PathParameters& path) {
  try {
    static_cast<void>(ready_version(context, request, path));
  } catch (const ApiError&) {
    throw;
  } catch (const StoreRefusal& error) {
    throw ApiError(code_of(error.reason()), error.what());
  } catch (const std::exception&) {
    // The handler meets it again, where it is logged.
    return;
  }
}

const localization::Aligner& choose_aligner(const Aligners& aligners, const std::string& method) {
  if (method.empty()) return *aligners.front().second;
  std::string names;
  for (const auto& [name, aligner] : aligners) {
    if (name == method) return *aligner;
    names += (names.empty() ? "" : ", ") + name;
  }
  throw field_error(ErrorCode::kUnknownMethod, "method", "'" + method + "'", names);
}

std::optional<localization::Prior> prior_in(const ServedVersion& map,
                                            const std::optional<localization::Prior>& prior,
                                            const std::optional<GnssFix>& gnss) {
  if (!gnss) return prior;
  const auto& origin = map.package->manifest().geodetic_origin;
  if (!origin) {
    throw field_error(
        ErrorCode::kNoGeodeticOrigin, "gnss", "a map without geodetic_origin",
        "a prior in the map frame, or a map with a place on the Earth (build --geo-origin)");
  }
  return prior_from(*gnss, *origin, map.seen_from->poses(*map.package));
}

bool is_reference(std::string_view method) {
  return !method.empty() && method != localization::aligner_names().front();
}

WorkKind kind_of(const PoseParameters& parameters) {
  if (is_reference(parameters.method)) return WorkKind::kReference;
  return parameters.prior ? WorkKind::kNearPrior : WorkKind::kEverywhere;
}

PoseClock::time_point deadline_of(const Context& context, const HttpRequest& request,
                                  std::optional<std::chrono::milliseconds> deadline) {
  return request.received +
         deadline.value_or(std::chrono::milliseconds(context.options.default_deadline_ms));
}

void check_deadline(PoseClock::time_point deadline) {
  if (PoseClock::now() <= deadline) return;
  throw ApiError(ErrorCode::kDeadlineExceeded, "the deadline passed before the answer was there");
}

void require_client(const HttpRequest& request) {
  if (request.client_gone && request.client_gone())
    throw ApiError(ErrorCode::kClientGone, "the client closed the connection before the answer");
}

void require_wanted(const HttpRequest& request, PoseClock::time_point deadline) {
  check_deadline(deadline);
  require_client(request);
}

std::size_t body_bytes(const Context& context, const HttpRequest& request) {
  // A JSON text, the values that are read from it and the points: see `JsonBounds`.
  constexpr std::size_t kJsonFactor = 8;
  const ServerOptions& options = context.options;
  const bool is_json = media_type(request.header("content-type")) == "application/json";
  const std::size_t most = is_json ? options.max_json_bytes : options.max_payload_bytes;
  std::size_t bytes = most;
  const std::string encoding = lower(request.header("content-encoding"));
  // Deflate packs up to a thousand to one, so the packed length bounds nothing.
  if (encoding.empty() || encoding == "identity") {
    const std::string text = request.header("content-length");
    bytes = request.body.size();
    std::from_chars(text.data(), text.data() + text.size(), bytes);
  }
  // A longer one is refused right after.
  bytes = std::min(bytes, most);
  return is_json ? std::min(kJsonFactor * bytes, options.max_bodies_bytes) : bytes;
}

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

std::shared_ptr<void> reserve_room(const Context& context, const HttpRequest& request,
                                   WorkKind kind, int units) {
  const AlignmentQueue::Work work{
      .kind = kind,
      .units = units,
      .deadline = deadline_of(context, request, read_flat_deadline(request.query))};
  return std::make_shared<AlignmentQueue::Reservation>(
      context.queue.reserve(request.caller.key_id, body_bytes(context, request), work));
}

const AlignmentQueue::Reservation& reservation_of(const HttpRequest& request) {
  return *static_cast<const AlignmentQueue::Reservation*>(request.reservation.get());
}

localization::ThinScan scan_to_match(PoseRequest& request, const Thinner& thin,
                                     PoseAnswer& answer) {
  answer.no_returns = request.no_returns;
  const std::vector<maps::Box>& movable = request.parameters.movable;
  if (auto* sent = std::get_if<localization::SentScan>(&request.scan_lidar)) {
    if (!movable.empty())
      throw field_error(ErrorCode::kUnsupportedMediaType, "movable", "boxes with a thinned scan",
                        "the whole scan: send it as application/octet-stream");
    // Of an empty scan: for which vehicle it thins.
    if (const float own_vehicle_m = thin({}).own_vehicle_m;
        sent->scan.own_vehicle_m != own_vehicle_m)
      throw field_error(
          ErrorCode::kInvalidScan, "scan",
          fmt::format("thinned with own_vehicle_m {}", sent->scan.own_vehicle_m),
          fmt::format("{}, as this server is configured: thin it with that", own_vehicle_m));
    return std::move(sent->scan);
  }
  auto* cloud = std::get_if<maps::PointCloud>(&request.scan_lidar);
  if (movable.empty())
    return thin(cloud != nullptr ? localization::view_of(*cloud)
                                 : std::get<localization::ScanView>(request.scan_lidar));
  maps::PointCloud scan =
      cloud != nullptr
          ? std::move(*cloud)
          : localization::whole_scan(std::get<localization::ScanView>(request.scan_lidar))
                .points_lidar;
  const std::size_t points = scan.size();
  scan = localization::without_points_in(scan, movable);
  answer.movable_points = points - scan.size();
  return thin(localization::view_of(scan));
}

PoseAnswer answer_for(const ServedVersion& map, const HttpRequest& request) {
  PoseAnswer answer;
  answer.map_name = map.map;
  answer.map_version = map.version;
  answer.map_digest = map.package->digest();
  answer.request_id = request.request_id;
  return answer;
}

PoseAnswer answer_for(const ServedVersion& map, const HttpRequest& request,
                      const PathParameters& path) {
  PoseAnswer answer = answer_for(map, request);
  answer.vehicle = read_vehicle(request.query);
  answer.version_was_named = version_in(path).has_value();
  return answer;
}

namespace {

/// An answer that halts the roll-out is given all the same.
void count_for_rollout(const Context& context, const PoseAnswer& answer, std::string_view status) {
  using Group = RolloutCounts::Group;
  const std::optional<Rollout> rollout = context.catalog.rollout(answer.map_name);
  const Group group =
      context.rollout_counts.answered(answer.map_name, answer.map_version, status, rollout);
  if (group == Group::kNone) return;
  context.metrics.rollout_answered(answer.map_name, group == Group::kRollout ? "rollout" : "others",
                                   status);
  if (group != Group::kRollout) return;
  const std::string reason =
      reason_to_halt(context.rollout_counts.figures(*rollout), rollout->halt);
  if (reason.empty()) return;
  try {
    context.catalog.halt_rollout(*rollout, reason);
  } catch (const std::exception& error) {
    spdlog::error("a halted roll-out is not in the store: {}", error.what());
  }
}

}  // namespace

void count_answer(const Context& context, const PoseAnswer& answer, const std::string& method) {
  const std::string_view status = localization::name_of(answer.result.status);
  context.vehicles.seen(answer.map_name, answer.vehicle, answer.map_version, status, unix_ns());
  if (!answer.version_was_named) count_for_rollout(context, answer, status);
  context.metrics.aligned(answer.map_name,
                          method.empty() ? localization::aligner_names().front() : method, status,
                          1e-3 * answer.timing.align_ms);
}

void finish_answer(const Context& context, const HttpRequest& request, PoseAnswer& answer) {
  answer.timing.total_ms = milliseconds_since(request.received);
  context.stats.answered(answer.map_name, localization::name_of(answer.result.status),
                         answer.timing.align_ms, answer.timing.total_ms);
}

void note_clock_skew(const Context& context, PoseAnswer& answer) {
  const auto& stamp_ns = answer.parameters.stamp_ns;
  const double allowed_s = context.live.current()->max_clock_skew_s;
  if (!stamp_ns || allowed_s == 0.0) return;
  answer.clock_skew_s = clock_skew_s(*stamp_ns, std::chrono::system_clock::now(),
                                     std::chrono::duration<double>(allowed_s));
}

}  // namespace stillmap::server
