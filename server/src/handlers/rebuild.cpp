#include "bodies/jobs_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"

#include <algorithm>
#include <memory>
#include <utility>

namespace stillmap::server {
namespace {

/// @throws ApiError kInvalidRequest.
std::optional<std::string> idempotency_key(const HttpRequest& request) {
  const auto found = request.headers.find("idempotency-key");
  if (found == request.headers.end()) return std::nullopt;
  const std::string& key = found->second;
  const bool printable =
      std::all_of(key.begin(), key.end(), [](char byte) { return byte >= '!' && byte <= '~'; });
  if (!key.empty() && key.size() <= 128 && printable) return key;
  throw field_error(ErrorCode::kInvalidRequest, "Idempotency-Key",
                    std::to_string(key.size()) + " bytes", "1 to 128 of printable ASCII");
}

HttpResponse rebuild(const Context& context, const HttpRequest& request,
                     const PathParameters& path) {
  require_json(request);
  const JobTable::Enqueued enqueued =
      context.jobs.orders.rebuild(path.at("map"), read_rebuild_request(request.body),
                                  {request.caller.key_id, idempotency_key(request)});
  return accepted(context.jobs.live.view(enqueued.job));
}

}  // namespace

HttpResponse accepted(const JobView& job) {
  HttpResponse response = json_response(job_json(job), 202);
  response.headers.emplace_back("Location", "/v1/jobs/" + std::to_string(job.job.id));
  return response;
}

void add_rebuild_routes(std::vector<Route>& routes, const Context& context) {
  Route route{"POST",
              "/v1/maps/{map}/rebuild",
              [&context](const HttpRequest& request, const PathParameters& path) {
                return rebuild(context, request, path);
              },
              Access::kWrite,
              BodyKind::kWhole,
              kMostRebuildJson};
  // Each runs the mapper for its estimate, beside the jobs and not counted among them.
  constexpr int kMostEstimates = 2;
  route.reserve = [places = std::make_shared<SharedPlaces>()](const HttpRequest&,
                                                              const PathParameters&) {
    return places->take(kMostEstimates, {}, "requests for a rebuild");
  };
  routes.push_back(std::move(route));
}

}  // namespace stillmap::server
