#include "handlers/parts.hpp"

#include "bodies/drives_json.hpp"
#include "errors/api_error.hpp"
#include "errors/upload_errors.hpp"
#include "http/content_digest.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {
namespace {

std::int64_t part_number(const PathParameters& path) {
  const std::string& text = path.at("part");
  const std::optional<std::int64_t> n = id_in(text);
  if (n && *n >= 1 && *n <= DriveTable::kMostParts) return *n;
  throw field_error(ErrorCode::kInvalidRequest, "part", "'" + text + "'",
                    fmt::format("1 to {}", DriveTable::kMostParts));
}

void check_size(const StoredDrive& drive, std::uint64_t more, std::uint64_t most) {
  if (more <= most && drive.bytes <= most - more) return;
  throw field_error(ErrorCode::kPayloadTooLarge, drive.is_upload() ? "upload" : "drive",
                    fmt::format("{} bytes and {} more", drive.bytes, more),
                    fmt::format("at most {}", most));
}

}  // namespace

StoredDrive shown(const Context& context, StoredDrive drive) {
  drive.error = without_folder(std::move(drive.error), context.store.folder());
  return drive;
}

void require_here(const Context& context, const StoredDrive& drive) {
  const bool has_ended =
      drive.status == DriveStatus::kComplete || drive.status == DriveStatus::kFailed;
  if (has_ended || context.jobs.folders.has_files_of(drive.files_at)) return;
  throw ApiError(
      ErrorCode::kOtherServer,
      fmt::format("{} is in the folder of server {}: ask that one, or open a new {} here",
                  drive_name(drive), drive.files_at, drive.is_upload() ? "upload" : "drive"));
}

HttpResponse put_part(const Context& context, const HttpRequest& request,
                      const PathParameters& path, const StoredDrive& drive, std::uint64_t most) {
  const std::int64_t n = part_number(path);
  const std::optional<std::string> sha256 = wanted_sha256(request);
  BodyStream& body = *request.stream;
  const std::vector<DrivePart> parts = context.store.drives().parts(drive.id);
  const bool known =
      std::any_of(parts.begin(), parts.end(), [&](const auto& part) { return part.n == n; });
  if (!known) check_size(drive, body.size(), most);
  const auto source = [&body](std::span<char> to) { return body.read(to); };
  return with_upload_errors(context.store.folder(), [&] {
    const DriveStore::Added added =
        context.drives.add_part(drive.id, {n, body.size(), source, sha256}, {.bytes = most});
    return json_response(part_json(added.part), added.is_new ? 201 : 200);
  });
}

}  // namespace stillmap::server
