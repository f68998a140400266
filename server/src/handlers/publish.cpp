#include "handlers/publish.hpp"

#include "errors/api_error.hpp"
#include "errors/upload_errors.hpp"

#include <stillmap/maps/cloud_file.hpp>

#include <algorithm>
#include <array>
#include <span>
#include <string_view>

namespace stillmap::server {
namespace {

ArchiveLimits archive_limits(const UploadOptions& options) {
  ArchiveLimits limits;
  limits.entries = bound_of(options.max_entries);
  limits.ratio = options.max_unpacked_ratio;
  return limits;
}

/// "pcd", "ply" or "las" for a map from elsewhere, which must be converted; nothing for a package.
std::optional<std::string> cloud_format(const std::string& content_type) {
  if (content_type == "application/vnd.pcd") return "pcd";
  if (content_type == "application/ply") return "ply";
  if (content_type == "application/vnd.las") return "las";
  return std::nullopt;
}

/// What the bytes begin with, as far as a header of a point cloud may reach.
std::string head_of(const ByteSource& source) {
  std::string head(maps::kMostCloudHeaderBytes, '\0');
  std::size_t have = 0;
  while (have < head.size()) {
    const std::size_t got = source(std::span(head).subspan(have));
    if (got == 0) break;
    have += got;
  }
  head.resize(have);
  return head;
}

/// 202 while it is converted, 200 when that was done before.
HttpResponse convert(const Context& context, const Publication& wanted, const std::string& format) {
  // Sent again, the file of a job that waits takes no more room; another one will be refused.
  const auto before = context.jobs.orders.newest_conversion(wanted.map, wanted.version);
  if (!before || is_finished(before->status))
    context.jobs.uploads.check_quota(wanted.map, wanted.bytes);
  const std::string name = wanted.map + "/" + wanted.version;
  const std::string head = head_of(wanted.source);
  maps::check_cloud_header(std::as_bytes(std::span(head)), format, name);
  const auto source = [&wanted, left = std::string_view(head)](std::span<char> to) mutable {
    if (left.empty()) return wanted.source(to);
    const std::size_t count = left.copy(to.data(), to.size());
    left.remove_prefix(count);
    return count;
  };
  const std::string sha256 =
      context.jobs.uploads.receive(source, wanted.bytes, wanted.sha256, name);
  const JobTable::Enqueued enqueued = context.jobs.orders.convert(
      wanted.map, {.version = wanted.version, .sha256 = sha256, .format = format},
      {wanted.key_id, std::nullopt});
  if (enqueued.job.status != JobStatus::kSucceeded)
    return accepted(context.jobs.live.view(enqueued.job));
  return json_response(version_json(context.store.state().version(wanted.map, wanted.version)));
}

}  // namespace

void check_publication_type(const std::string& field, const std::string& media_type) {
  constexpr std::array<std::string_view, 8> kTypes = {"",
                                                      "application/x-tar",
                                                      "application/gzip",
                                                      "application/zstd",
                                                      "application/octet-stream",
                                                      "application/vnd.pcd",
                                                      "application/ply",
                                                      "application/vnd.las"};
  if (std::find(kTypes.begin(), kTypes.end(), media_type) != kTypes.end()) return;
  throw field_error(ErrorCode::kUnsupportedMediaType, field, "'" + media_type + "'",
                    "application/x-tar, application/gzip, application/zstd, application/vnd.pcd, "
                    "application/ply or application/vnd.las");
}

HttpResponse publish_bytes(const Context& context, const Publication& wanted) {
  context.store.check_disk_reserve(wanted.bytes);
  if (const auto format = cloud_format(wanted.content_type))
    return convert(context, wanted, *format);
  const PackageStore::Added added =
      context.store.add_archive(wanted.map, wanted.version,
                                {wanted.source, wanted.map + "/" + wanted.version,
                                 archive_limits(context.live.current()->uploads)},
                                wanted.sha256);
  HttpResponse response = json_response(version_json(added.version), added.is_new ? 201 : 200);
  if (added.is_new) {
    response.headers.emplace_back("Location",
                                  "/v1/maps/" + wanted.map + "/versions/" + wanted.version);
  }
  return response;
}

HttpResponse publish(const Context& context, const Publication& wanted) {
  return with_upload_errors(context.store, [&] { return publish_bytes(context, wanted); });
}

}  // namespace stillmap::server
