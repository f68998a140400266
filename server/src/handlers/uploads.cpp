#include "bodies/drives_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"
#include "errors/upload_errors.hpp"
#include "handlers/parts.hpp"
#include "handlers/publish.hpp"

#include <fmt/format.h>

#include "store/store_refusal.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

std::uint64_t most_bytes(const Context& context) {
  return bound_of(context.options.uploads.max_package_bytes);
}

/// The upload that the path names, of the map that it names.
StoredDrive find_upload(const Context& context, const PathParameters& path) {
  const std::string& text = path.at("upload");
  if (const std::optional<std::int64_t> id = id_in(text)) {
    for (StoredDrive& upload : context.store.drives().uploads_of_map(path.at("map")))
      if (upload.id == *id) return upload;
  }
  throw ApiError(ErrorCode::kUnknownUpload,
                 fmt::format("map {} has no upload '{}'", path.at("map"), text));
}

HttpResponse answer_upload(const Context& context, const StoredDrive& upload, int status = 200) {
  return json_response(upload_json(shown(context, upload), context.store.drives().parts(upload.id)),
                       status);
}

HttpResponse open_upload(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  check_name(path, "map");
  require_json(request);
  const UploadRequest wanted = read_upload_json(request.body);
  check_publication_type("content_type", wanted.content_type);
  const std::string& map = path.at("map");
  context.store.create_map(map);
  const StoredDrive upload = context.store.drives().open_upload(
      map, {.version = wanted.version, .content_type = wanted.content_type}, unix_ns(),
      context.jobs.folders.server_of_drives());
  HttpResponse response = answer_upload(context, upload, 201);
  response.headers.emplace_back("Location", fmt::format("/v1/maps/{}/uploads/{}", map, upload.id));
  return response;
}

HttpResponse list_uploads(const Context& context, const PathParameters& path) {
  std::vector<StoredDrive> uploads = context.store.drives().uploads_of_map(path.at("map"));
  for (StoredDrive& upload : uploads) upload = shown(context, std::move(upload));
  return json_response(upload_list_json(uploads));
}

/// What came of one that was completed before.
HttpResponse answer_completed(const Context& context, const StoredDrive& upload) {
  const auto version = context.store.state().find_version(upload.map, upload.target.version);
  if (version) return json_response(version_json(*version));
  if (const auto job = context.jobs.orders.newest_conversion(upload.map, upload.target.version))
    return accepted(context.jobs.live.view(*job));
  throw ApiError(ErrorCode::kUnknownVersion, fmt::format("version {} of map {} was removed",
                                                         upload.target.version, upload.map));
}

HttpResponse complete_upload(const Context& context, const HttpRequest& request,
                             const PathParameters& path) {
  const StoredDrive upload = find_upload(context, path);
  if (upload.status == DriveStatus::kComplete) return answer_completed(context, upload);
  return with_upload_errors(context.store, [&] {
    std::optional<HttpResponse> response;
    context.drives.complete_upload(upload.id, [&](const ByteSource& source, std::uint64_t bytes) {
      response = publish_bytes(context, {.map = upload.map,
                                         .version = upload.target.version,
                                         .content_type = upload.target.content_type,
                                         .key_id = request.caller.key_id,
                                         .source = source,
                                         .bytes = bytes});
    });
    // Somebody else was first.
    return response ? std::move(*response) : answer_completed(context, upload);
  });
}

HttpResponse remove_upload(const Context& context, const PathParameters& path) {
  context.drives.remove(find_upload(context, path).id);
  return {.status = 204, .content_type = {}, .body = {}, .headers = {}};
}

/// Parts are large, and unpacking is slow: both take a place.
void add_part_routes(std::vector<Route>& routes, const Context& context) {
  const auto reserve = [&context](const HttpRequest& request, const PathParameters& path) {
    require_here(context, find_upload(context, path));
    return context.uploads.take(context.live.current()->uploads.max_open, request.caller.key_id);
  };
  Route part{"PUT",
             "/v1/maps/{map}/uploads/{upload}/parts/{part}",
             [&context](const HttpRequest& request, const PathParameters& path) {
               return put_part(context, request, path, find_upload(context, path),
                               most_bytes(context));
             },
             Access::kWrite,
             BodyKind::kStreamed,
             most_bytes(context)};
  Route complete{"POST", "/v1/maps/{map}/uploads/{upload}/complete",
                 [&context](const HttpRequest& request, const PathParameters& path) {
                   return complete_upload(context, request, path);
                 },
                 Access::kWrite};
  for (Route* each : {&part, &complete}) {
    each->reserve = reserve;
    routes.push_back(std::move(*each));
  }
}

}  // namespace

void add_upload_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"POST", "/v1/maps/{map}/uploads",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return open_upload(context, request, path);
                    },
                    Access::kWrite, BodyKind::kWhole, kMostDriveJson});
  routes.push_back(
      {"GET", "/v1/maps/{map}/uploads", [&context](const HttpRequest&, const PathParameters& path) {
         return list_uploads(context, path);
       }});
  routes.push_back({"GET", "/v1/maps/{map}/uploads/{upload}",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return answer_upload(context, find_upload(context, path));
                    }});
  routes.push_back({"DELETE", "/v1/maps/{map}/uploads/{upload}",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return remove_upload(context, path);
                    },
                    Access::kWrite});
  add_part_routes(routes, context);
}

}  // namespace stillmap::server
