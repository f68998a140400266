#include "bodies/keys_request_json.hpp"
#include "bodies/store_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"

namespace stillmap::server {
namespace {

constexpr std::int64_t kDay_ns = std::int64_t{86'400} * 1'000'000'000;

/// A caller without a key was let in because there is no key. Whoever makes the first one locks all
/// others out, so that needs access to the machine.
void refuse_first_key(const HttpRequest& request) {
  if (!request.caller.key_id.empty()) return;
  throw ApiError(ErrorCode::kForbidden,
                 "the store has no key yet, and the first one is made on the server's machine: "
                 "stillmap keys create NAME --store DIR --scope admin");
}

/// The secret is in this answer and nowhere else.
HttpResponse create_key(const Context& context, const HttpRequest& request) {
  refuse_first_key(request);
  require_json(request);
  const KeyRequest wanted = read_key_request(request.body);
  const std::int64_t now = unix_ns();
  std::optional<std::int64_t> expires;
  if (wanted.expires_days) expires = now + *wanted.expires_days * kDay_ns;
  HttpResponse response = json_response(created_key_json(context.store.keys().create(
                                            wanted.name, wanted.scopes, expires, now, wanted.maps)),
                                        201);
  response.headers.emplace_back("Cache-Control", "no-store");
  return response;
}

}  // namespace

void add_key_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"GET", "/v1/keys",
                    [&context](const HttpRequest&, const PathParameters&) {
                      return json_response(keys_json(context.store.keys().list()));
                    },
                    Access::kAdmin});
  routes.push_back({"POST", "/v1/keys",
                    [&context](const HttpRequest& request, const PathParameters&) {
                      return create_key(context, request);
                    },
                    Access::kAdmin, BodyKind::kWhole, kMostKeyJson});
  routes.push_back({"DELETE", "/v1/keys/{key}",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return json_response(
                          key_json(context.store.keys().revoke(path.at("key"), unix_ns())));
                    },
                    Access::kAdmin});
}

}  // namespace stillmap::server
