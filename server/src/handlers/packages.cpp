#include "context.hpp"
#include "errors/api_error.hpp"
#include "errors/upload_errors.hpp"
#include "http/content_digest.hpp"
#include "http/header_text.hpp"
#include "json/answers_json.hpp"

#include <fmt/format.h>

#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/store/archive.hpp>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <memory>
#include <span>
#include <stdexcept>
#include <string_view>
#include <utility>

namespace stillmap::server {
namespace {

/// Those that `stillmap build` draws take some 100 KiB.
constexpr std::uint64_t kMaxPreviewBytes = 16U << 20U;

/// A package on its way to a client.
class PackageSource final : public BodySource {
 public:
  explicit PackageSource(std::unique_ptr<maps::PackageArchive> archive)
      : archive_(std::move(archive)) {}
  [[nodiscard]] std::uint64_t size() const override { return archive_->size(); }
  void read(std::uint64_t offset, std::span<char> to) override {
    if (archive_->read(offset, to) != to.size())
      throw std::logic_error("asked beyond the end of the archive");
  }

 private:
  std::unique_ptr<maps::PackageArchive> archive_;
};

maps::ArchiveLimits limits_of(const UploadOptions& options) {
  maps::ArchiveLimits limits;
  limits.entries = static_cast<std::uint64_t>(options.max_entries);
  limits.ratio = options.max_unpacked_ratio;
  return limits;
}

void check_archive_type(const HttpRequest& request) {
  constexpr std::array kTypes = {"", "application/x-tar", "application/gzip", "application/zstd",
                                 "application/octet-stream"};
  const std::string type = media_type(request.header("content-type"));
  if (std::find(kTypes.begin(), kTypes.end(), type) != kTypes.end()) return;
  throw field_error(ErrorCode::kUnsupportedMediaType, "Content-Type", "'" + type + "'",
                    "application/x-tar, application/gzip, application/zstd, application/vnd.pcd, "
                    "application/ply or application/vnd.las");
}

/// "pcd", "ply" or "las" for a map from elsewhere, which must be converted; nothing for a package.
std::optional<std::string> cloud_format(const HttpRequest& request) {
  const std::string type = media_type(request.header("content-type"));
  if (type == "application/vnd.pcd") return "pcd";
  if (type == "application/ply") return "ply";
  if (type == "application/vnd.las") return "las";
  return std::nullopt;
}

/// What the body begins with, as far as a header of a point cloud may reach.
std::string head_of(BodyStream& body) {
  std::string head(maps::kMostCloudHeaderBytes, '\0');
  std::size_t have = 0;
  while (have < head.size()) {
    const std::size_t got = body.read(std::span(head).subspan(have));
    if (got == 0) break;
    have += got;
  }
  head.resize(have);
  return head;
}

/// 202 while it is converted, 200 when that was done before.
HttpResponse put_cloud(const Context& context, const HttpRequest& request,
                       const PathParameters& path, const std::string& format) {
  const std::string& map = path.at("map");
  const std::string& version = path.at("version");
  const std::string name = map + "/" + version;
  BodyStream& body = *request.stream;
  const std::uint64_t bytes = body.size();
  context.store.check_quota(map, bytes);
  return with_upload_errors(context.store.folder(), [&] {
    const std::string head = head_of(body);
    maps::check_cloud_header(std::as_bytes(std::span(head)), format, name);
    const auto source = [&body, left = std::string_view(head)](std::span<char> to) mutable {
      if (left.empty()) return body.read(to);
      const std::size_t count = left.copy(to.data(), to.size());
      left.remove_prefix(count);
      return count;
    };
    const std::string sha256 = context.jobs.receive(source, bytes, wanted_sha256(request), name);
    const maps::JobTable::Enqueued enqueued =
        context.jobs.convert(map, {.version = version, .sha256 = sha256, .format = format},
                             {request.caller.key_id, std::nullopt});
    if (enqueued.job.status != maps::JobStatus::kSucceeded)
      return accepted(context.jobs.view(enqueued.job));
    return json_response(version_json(context.store.state().version(map, version)));
  });
}

HttpResponse put_version(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  const std::string& map = path.at("map");
  const std::string& version = path.at("version");
  check_name(path, "map");
  check_name(path, "version");
  if (const auto format = cloud_format(request)) return put_cloud(context, request, path, *format);
  check_archive_type(request);
  const std::optional<std::string> sha256 = wanted_sha256(request);
  BodyStream& body = *request.stream;
  const auto source = [&body](std::span<char> to) { return body.read(to); };
  return with_upload_errors(context.store.folder(), [&] {
    const maps::PackageStore::Added added =
        context.store.add_archive(map, version, source, map + "/" + version,
                                  limits_of(context.live.current()->uploads), sha256);
    HttpResponse response = json_response(version_json(added.version), added.is_new ? 201 : 200);
    if (added.is_new)
      response.headers.emplace_back("Location", "/v1/maps/" + map + "/versions/" + version);
    return response;
  });
}

HttpResponse get_content(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  auto archive = context.store.archive(path.at("map"), path.at("version"));
  HttpResponse response{.content_type = "application/x-tar", .body = {}, .headers = {}};
  response.headers = {{"ETag", archive->etag()},
                      {"Cache-Control", "public, max-age=31536000, immutable"},
                      {"Content-Disposition", "attachment; filename=\"" + path.at("map") + "-" +
                                                  path.at("version") + ".tar\""}};
  if (is_known_to_client(request.header("if-none-match"), archive->etag())) {
    response.status = 304;
    return response;
  }
  response.source = std::make_shared<PackageSource>(std::move(archive));
  return response;
}

/// Reads the picture that the package lists, if it does. @throws ApiError kUnknownRoute.
std::string preview_of(const maps::MapPackage& package) {
  const auto& files = package.manifest().files;
  const auto listed = files.find("preview.png");
  if (listed == files.end())
    throw ApiError(ErrorCode::kUnknownRoute, "this version was published without a preview");
  const std::filesystem::path path = package.folder() / "preview.png";
  if (listed->second.bytes > kMaxPreviewBytes)
    throw maps::InputError(path.string(), fmt::format("{} bytes", listed->second.bytes),
                           fmt::format("at most {}", kMaxPreviewBytes));
  std::string bytes(listed->second.bytes, '\0');
  std::ifstream file(path, std::ios::binary);
  if (!file.read(bytes.data(), static_cast<std::streamsize>(bytes.size())))
    throw maps::InputError(path.string(), "a shorter file", "the bytes that the manifest states");
  return bytes;
}

HttpResponse get_preview(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  const ServedVersion map = find_version(context.catalog, path);
  const std::string etag = "\"" + map.package->digest().substr(0, 16) + "-preview\"";
  HttpResponse response{.content_type = "image/png", .body = {}, .headers = {}};
  response.headers = {{"ETag", etag}, {"Cache-Control", "public, max-age=31536000, immutable"}};
  if (is_known_to_client(request.header("if-none-match"), etag)) {
    response.status = 304;
  } else {
    response.body = preview_of(*map.package);
  }
  return response;
}

}  // namespace

void add_package_routes(std::vector<Route>& routes, const Context& context) {
  Route put{"PUT",
            "/v1/maps/{map}/versions/{version}",
            [&context](const HttpRequest& request, const PathParameters& path) {
              return put_version(context, request, path);
            },
            Access::kWrite,
            BodyKind::kStreamed,
            static_cast<std::uint64_t>(context.options.uploads.max_package_bytes)};
  put.reserve = [&context](const HttpRequest& request, const PathParameters&) {
    return context.uploads.take(context.live.current()->uploads.max_open, request.caller.key_id);
  };
  routes.push_back(std::move(put));
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/content",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return get_content(context, request, path);
                    }});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/preview",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return get_preview(context, request, path);
                    }});
}

}  // namespace stillmap::server
