#include "context.hpp"
#include "errors/api_error.hpp"
#include "jobs/job_request.hpp"
#include "json/request_json.hpp"

#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/error.hpp>
#include "store/store_refusal.hpp"

#include <utility>

namespace stillmap::server {
namespace {

std::string edits_etag(const SavedEdits& edits) { return "\"" + edits.sha256.substr(0, 16) + "\""; }

HttpResponse answer(const SavedEdits& edits) {
  HttpResponse response = json_response(edits.text);
  response.headers = {{"ETag", edits_etag(edits)}, {"Cache-Control", "no-cache"}};
  return response;
}

HttpResponse get_edits(const Context& context, const HttpRequest& request,
                       const PathParameters& path) {
  const SavedEdits edits = context.store.edits().of_map(path.at("map"));
  HttpResponse response = answer(edits);
  if (!is_known_to_client(request.header("if-none-match"), edits_etag(edits))) return response;
  response.status = 304;
  response.body.clear();
  return response;
}

/// As the store keeps it: equal corrections have equal texts. @throws ApiError kInvalidRequest.
std::string read_edits(const HttpRequest& request) {
  std::string text = parse_request_json(request.body, {.max_bytes = EditsTable::kMostBytes,
                                                       .max_values = kMostEditValues})
                         .dump();
  try {
    static_cast<void>(maps::parse_edits(text, "edits"));
  } catch (const maps::InputError& error) {
    throw ApiError(ErrorCode::kInvalidRequest, error.what());
  }
  // Numbers can be longer than they came.
  if (text.size() <= EditsTable::kMostBytes) return text;
  throw field_error(ErrorCode::kPayloadTooLarge, "edits", std::to_string(text.size()) + " bytes",
                    "at most " + std::to_string(EditsTable::kMostBytes));
}

/// SHA-256 of what the client means to replace. @throws StoreRefusal kOtherRevision.
std::optional<std::string> wanted_before(const Context& context, const HttpRequest& request,
                                         const std::string& map) {
  const std::string tag = request.header("if-match");
  const SavedEdits known = context.store.edits().of_map(map);
  if (tag.empty() || tag == "*") return std::nullopt;
  if (tag == edits_etag(known)) return known.sha256;
  throw StoreRefusal(StoreRefusal::Reason::kOtherRevision,
                     "the corrections of map '" + map + "' were changed meanwhile");
}

HttpResponse put_edits(const Context& context, const HttpRequest& request,
                       const PathParameters& path) {
  require_json(request);
  const std::string& map = path.at("map");
  const std::optional<std::string> before = wanted_before(context, request, map);
  context.store.check_disk_reserve(request.body.size());
  return answer(context.store.edits().save(map, read_edits(request), request.caller.key_id,
                                           unix_ns(), before));
}

}  // namespace

void add_edit_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"GET", "/v1/maps/{map}/edits",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return get_edits(context, request, path);
                    }});
  routes.push_back({"PUT", "/v1/maps/{map}/edits",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return put_edits(context, request, path);
                    },
                    Access::kWrite, BodyKind::kWhole, EditsTable::kMostBytes});
}

}  // namespace stillmap::server
