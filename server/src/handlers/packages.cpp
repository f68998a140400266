#include "bodies/maps_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"
#include "errors/upload_errors.hpp"
#include "handlers/page_query.hpp"
#include "handlers/publish.hpp"
#include "handlers/tile_answer.hpp"
#include "http/content_digest.hpp"
#include "http/header_text.hpp"

#include "store/store_folder.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <stillmap/maps/error.hpp>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <span>
#include <stdexcept>
#include <string_view>
#include <utility>

namespace stillmap::server {
namespace {

/// Those that `stillmap build` draws take some 100 KiB.
constexpr std::uint64_t kMaxPreviewBytes = 16U << 20U;

/// A package, or one file of it, on its way to a client.
class PackageSource final : public BodySource {
 public:
  explicit PackageSource(std::unique_ptr<PackageArchive> archive)
      : archive_(std::move(archive)), place_{0, archive_->size()} {}
  PackageSource(std::unique_ptr<PackageArchive> archive, PackageArchive::Place place)
      : archive_(std::move(archive)), place_(place) {}
  [[nodiscard]] std::uint64_t size() const override { return place_.bytes; }
  void read(std::uint64_t offset, std::span<char> to) override {
    if (archive_->read(place_.offset + offset, to) != to.size())
      throw std::logic_error("asked beyond the end of the archive");
  }

 private:
  std::unique_ptr<PackageArchive> archive_;
  PackageArchive::Place place_;
};

HttpResponse put_version(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  check_name(path, "map");
  check_name(path, "version");
  const std::string type = media_type(request.header("content-type"));
  check_publication_type("Content-Type", type);
  BodyStream& body = *request.stream;
  return publish(context, {.map = path.at("map"),
                           .version = path.at("version"),
                           .content_type = type,
                           .key_id = request.caller.key_id,
                           .source = [&body](std::span<char> to) { return body.read(to); },
                           .bytes = body.size(),
                           .sha256 = wanted_sha256(request)});
}

/// The refusal for a package with a damaged file. It is logged too.
ApiError damaged(const PathParameters& path, const std::string& file) {
  const std::string text = fmt::format(
      "version '{}' of map '{}' is damaged on the disk: {} is not what its manifest says; to "
      "repair it, add the same package again",
      path.at("version"), path.at("map"), file);
  spdlog::error("{}", text);
  return {ErrorCode::kStorageError, text};
}

/// The digest that `from` in the query says; empty without one. @throws ApiError.
std::string from_in(const std::map<std::string, std::string>& query) {
  const auto from = query.find("from");
  if (from == query.end()) return {};
  if (!is_digest(from->second))
    throw field_error(ErrorCode::kInvalidRequest, "from", "'" + from->second + "'",
                      "the digest of a version: 64 digits of 0-9 and a-f");
  return from->second;
}

HttpResponse get_content(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  const std::string from = from_in(read_query(request, {"from"}));
  auto archive = context.store.archive(path.at("map"), path.at("version"), from);
  HttpResponse response{.content_type = "application/x-tar", .body = {}, .headers = {}};
  response.headers = {{"ETag", archive->etag()},
                      {"Cache-Control", kKeptForEver},
                      {"Content-Disposition", "attachment; filename=\"" + path.at("map") + "-" +
                                                  path.at("version") + ".tar\""}};
  if (is_known_to_client(request.header("if-none-match"), archive->etag())) {
    response.status = 304;
    return response;
  }
  if (const std::string file = context.store.damage_of(*archive); !file.empty())
    throw damaged(path, file);
  response.source = std::make_shared<PackageSource>(std::move(archive));
  return response;
}

HttpResponse get_file(const Context& context, const HttpRequest& request,
                      const PathParameters& path) {
  auto archive = context.store.archive(path.at("map"), path.at("version"));
  const std::string& sha256 = path.at("checksum");
  const auto place = archive->place_of(sha256);
  if (!place)
    throw ApiError(ErrorCode::kUnknownRoute,
                   "version '" + path.at("version") + "' has no file of the SHA-256 '" + sha256 +
                       "'; its delta and its manifest.json list those that it has");
  // What a checksum names never changes.
  const std::string etag = '"' + sha256 + '"';
  HttpResponse response{.content_type = "application/octet-stream", .body = {}, .headers = {}};
  response.headers = {{"ETag", etag}, {"Cache-Control", kKeptForEver}};
  if (is_known_to_client(request.header("if-none-match"), etag)) {
    response.status = 304;
    return response;
  }
  if (const std::string file = context.store.damage_of(*archive); !file.empty())
    throw damaged(path, file);
  response.source = std::make_shared<PackageSource>(std::move(archive), *place);
  return response;
}

HttpResponse get_delta(const Context& context, const HttpRequest& request,
                       const PathParameters& path) {
  const std::string from = from_in(read_query(request, {"from"}));
  if (from.empty())
    throw field_error(ErrorCode::kInvalidRequest, "from", "nothing",
                      "the digest of the version that is there already");
  const StoredVersion version = context.store.state().version(path.at("map"), path.at("version"));
  return json_response(
      delta_json(from, version.digest, context.store.delta(path.at("map"), version.name, from)));
}

/// Reads the picture that the package lists, if it does.
/// @throws ApiError kUnknownRoute, kStorageError.
std::string preview_of(const maps::MapPackage& package, const PathParameters& names) {
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
  if (!file.read(bytes.data(), static_cast<std::streamsize>(bytes.size())) ||
      maps::sha256_of(bytes) != listed->second.sha256)
    throw damaged(names, "preview.png");
  return bytes;
}

HttpResponse get_preview(const Context& context, const HttpRequest& request,
                         const PathParameters& path) {
  const ServedVersion map = find_version(context.catalog, path);
  const std::string etag = "\"" + map.package->digest().substr(0, 16) + "-preview\"";
  HttpResponse response{.content_type = "image/png", .body = {}, .headers = {}};
  response.headers = {{"ETag", etag}, {"Cache-Control", kKeptForEver}};
  if (is_known_to_client(request.header("if-none-match"), etag)) {
    response.status = 304;
  } else {
    response.body = preview_of(*map.package, path);
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
            bound_of(context.options.uploads.max_package_bytes)};
  put.reserve = [&context](const HttpRequest& request, const PathParameters&) {
    return context.uploads.take(context.live.current()->uploads.max_open, request.caller.key_id);
  };
  routes.push_back(std::move(put));
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/content",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return get_content(context, request, path);
                    }});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/delta",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return get_delta(context, request, path);
                    }});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/files/{checksum}",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return get_file(context, request, path);
                    }});
  routes.push_back({"GET", "/v1/maps/{map}/versions/{version}/preview",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return get_preview(context, request, path);
                    }});
}

}  // namespace stillmap::server
