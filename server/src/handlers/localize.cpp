#include "api_error.hpp"
#include "context.hpp"
#include "json/answers_json.hpp"
#include "pose_request.hpp"

#include <stillmap/localization/movable.hpp>

#include <cstddef>
#include <optional>
#include <string>

namespace stillmap::server {
namespace {

using Clock = std::chrono::steady_clock;

double milliseconds_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

const Aligners& aligners_of(const ServedMap& map) {
  if (map.state == MapState::kLoading) {
    throw ApiError(ErrorCode::kMapLoading, "map '" + map.name + "' is still being loaded")
        .with_header("Retry-After", "1");
  }
  if (map.state == MapState::kFailed) {
    throw ApiError(ErrorCode::kMapUnusable, "map '" + map.name + "' could not be loaded");
  }
  return *map.aligners;
}

const localization::Aligner& choose(const Aligners& aligners, const std::string& method) {
  if (method.empty()) return *aligners.front().second;
  std::string names;
  for (const auto& [name, aligner] : aligners) {
    if (name == method) return *aligner;
    names += (names.empty() ? "" : ", ") + name;
  }
  throw field_error(ErrorCode::kUnknownMethod, "method", "'" + method + "'", names);
}

void check_deadline(const std::optional<Clock::time_point>& deadline) {
  if (!deadline || Clock::now() <= *deadline) return;
  throw ApiError(ErrorCode::kDeadlineExceeded, "the deadline passed before the answer was there");
}

HttpResponse answer_localize(const Context& context, const HttpRequest& request,
                             const PathParameters& path) {
  const ServedMap map = find_version(context.catalog, path);
  const Aligners& aligners = aligners_of(map);
  PoseRequest pose_request = read_pose_request(request, context.options);
  const localization::Aligner& aligner = choose(aligners, pose_request.parameters.method);
  PoseAnswer answer{.parameters = std::move(pose_request.parameters),
                    .map_name = map.name,
                    .map_digest = map.package->digest(),
                    .request_id = request.request_id};
  answer.timing.decode_ms = milliseconds_since(request.received);

  std::optional<Clock::time_point> deadline;
  if (answer.parameters.deadline) deadline = request.received + *answer.parameters.deadline;
  {
    const AlignmentGate::Ticket ticket = context.gate.enter(deadline);
    check_deadline(deadline);
    const Clock::time_point begin = Clock::now();
    const std::size_t points = pose_request.scan_lidar.size();
    if (!answer.parameters.movable.empty()) {
      pose_request.scan_lidar =
          localization::without_points_in(pose_request.scan_lidar, answer.parameters.movable);
    }
    answer.movable_points = points - pose_request.scan_lidar.size();
    answer.result = aligner.align(pose_request.scan_lidar, answer.parameters.prior);
    answer.timing.align_ms = milliseconds_since(begin);
  }
  check_deadline(deadline);
  answer.timing.total_ms = milliseconds_since(request.received);
  return json_response(pose_answer_json(answer));
}

}  // namespace

void add_localize_routes(std::vector<Route>& routes, const Context& context) {
  const Handler localize = [&context](const HttpRequest& request, const PathParameters& path) {
    return answer_localize(context, request, path);
  };
  routes.push_back(
      {"POST", "/v1/maps/{map}/localize", localize, Access::kLocalize, BodyKind::kWhole});
  routes.push_back({"POST", "/v1/maps/{map}/versions/{version}/localize", localize,
                    Access::kLocalize, BodyKind::kWhole});
}

}  // namespace stillmap::server
