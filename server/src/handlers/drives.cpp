#include "bodies/drives_json.hpp"
#include "bodies/inspection_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"
#include "errors/upload_errors.hpp"
#include "handlers/parts.hpp"

#include <stillmap/maps/scan_limit.hpp>

#include <fmt/format.h>

#include "store/store_refusal.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

namespace stillmap::server {
namespace {

DriveStore::Limits drive_limits(const UploadOptions& options) {
  DriveStore::Limits limits;
  limits.bytes = bound_of(options.max_drive_bytes);
  limits.archive.entries = bound_of(options.max_entries);
  // Labels pack to a fortieth: what bounds packages would refuse good drives.
  limits.archive.ratio = std::max(limits.archive.ratio, options.max_unpacked_ratio);
  // A recording is often a single file.
  limits.archive.file_bytes = limits.archive.total_bytes = limits.bytes;
  return limits;
}

/// The drive that the path names, of the map that it names.
StoredDrive find_drive(const Context& context, const PathParameters& path) {
  const std::string& text = path.at("drive");
  if (const std::optional<std::int64_t> id = id_in(text)) {
    try {
      StoredDrive drive = context.store.drives().drive(*id);
      if (drive.map == path.at("map") && !drive.is_upload()) return drive;
    } catch (const StoreRefusal&) {
      // Not there: the answer is that for a drive of another map, which tells nothing of it.
    }
  }
  throw ApiError(ErrorCode::kUnknownDrive,
                 fmt::format("map {} has no drive '{}'", path.at("map"), text));
}

HttpResponse answer_drive(const Context& context, const StoredDrive& drive, int status = 200) {
  return json_response(drive_json(shown(context, drive), context.store.drives().parts(drive.id)),
                       status);
}

HttpResponse open_drive(const Context& context, const HttpRequest& request,
                        const PathParameters& path) {
  require_json_if_any(request);
  const std::string name = read_drive_json(request.body);
  const StoredDrive drive = context.store.drives().open(path.at("map"), name, unix_ns(),
                                                        context.jobs.folders.server_of_drives());
  HttpResponse response = answer_drive(context, drive, 201);
  response.headers.emplace_back("Location",
                                fmt::format("/v1/maps/{}/drives/{}", drive.map, drive.id));
  return response;
}

HttpResponse list_drives(const Context& context, const PathParameters& path) {
  std::vector<StoredDrive> drives = context.store.drives().of_map(path.at("map"));
  for (StoredDrive& drive : drives) drive = shown(context, std::move(drive));
  return json_response(drive_list_json(drives));
}

/// A drive with a broken scan is a drive all the same: its build may not read that scan.
std::string unreadable_json(const maps::Drive& drive, const std::exception& error) {
  DriveSummary summary = summarize_unread(drive);
  summary.check.findings.push_back(
      {"unreadable", fmt::format("a scan could not be inspected: {}", error.what()),
       "if a build of the drive fails too, repair or remove the scan, and upload the drive again"});
  return listed_inspection_json(summary);
}

/// @param max_points  of a scan.
DriveStore::Found inspect_drive(const OpenedDrive& opened, std::size_t max_points) {
  const maps::ScanLimit limit(max_points);
  if (opened.needs_choice) return {{}, listed_inspection_json(*opened.needs_choice)};
  const maps::Drive& drive = *opened.drive;
  try {
    return {{}, listed_inspection_json(summarize(drive))};
  } catch (const maps::StorageError&) {
    throw;
  } catch (const maps::CalibrationError& error) {
    if (!maps::takes_recording_choice(drive.contents().root))
      return {{}, unreadable_json(drive, error)};
    return {error.what(), listed_inspection_json(maps::ChoiceError(error, topic_of_clouds(drive)))};
  } catch (const std::exception& error) {
    return {{}, unreadable_json(drive, error)};
  }
}

HttpResponse complete_drive(const Context& context, const HttpRequest& request,
                            const PathParameters& path) {
  require_json_if_any(request);
  DriveStore::Completion wanted{.limits = drive_limits(context.live.current()->uploads),
                                .choice = read_choice_json(request.body)};
  const std::filesystem::path store = context.store.folder();
  wanted.inspect = [&](const OpenedDrive& opened) {
    DriveStore::Found found = inspect_drive(opened, context.options.max_scan_points);
    found.inspection = without_folder(std::move(found.inspection), store);
    return found;
  };
  const StoredDrive drive = find_drive(context, path);
  return with_upload_errors(store, [&] {
    const StoredDrive done = context.drives.complete(drive.id, wanted);
    return answer_drive(context, done, done.status == DriveStatus::kNeedsChoice ? 202 : 200);
  });
}

HttpResponse remove_drive(const Context& context, const PathParameters& path) {
  context.drives.remove(find_drive(context, path).id);
  return {.status = 204, .content_type = {}, .body = {}, .headers = {}};
}

/// Parts are large, and unpacking is slow: both take a place.
void add_drive_byte_routes(std::vector<Route>& routes, const Context& context) {
  const auto reserve = [&context](const HttpRequest& request, const PathParameters& path) {
    require_here(context, find_drive(context, path));
    return context.uploads.take(context.live.current()->uploads.max_open, request.caller.key_id);
  };
  Route part{"PUT",
             "/v1/maps/{map}/drives/{drive}/parts/{part}",
             [&context](const HttpRequest& request, const PathParameters& path) {
               return put_part(context, request, path, find_drive(context, path),
                               bound_of(context.options.uploads.max_drive_bytes));
             },
             Access::kWrite,
             BodyKind::kStreamed,
             bound_of(context.options.uploads.max_drive_bytes)};
  Route complete{"POST",
                 "/v1/maps/{map}/drives/{drive}/complete",
                 [&context](const HttpRequest& request, const PathParameters& path) {
                   return complete_drive(context, request, path);
                 },
                 Access::kWrite,
                 BodyKind::kWhole,
                 kMostDriveJson};
  // A recording may need a choice; other drives are completed without a word.
  complete.body_is_optional = true;
  part.reserve = reserve;
  // A form of another site's page learns nothing of what is there.
  complete.reserve = [reserve](const HttpRequest& request, const PathParameters& path) {
    require_json_if_any(request);
    return reserve(request, path);
  };
  for (Route* each : {&part, &complete}) routes.push_back(std::move(*each));
}

}  // namespace

void add_drive_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back({"POST", "/v1/maps/{map}/drives",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return open_drive(context, request, path);
                    },
                    Access::kWrite, BodyKind::kWhole, kMostDriveJson});
  routes.push_back(
      {"GET", "/v1/maps/{map}/drives", [&context](const HttpRequest&, const PathParameters& path) {
         return list_drives(context, path);
       }});
  routes.push_back({"GET", "/v1/maps/{map}/drives/{drive}",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return answer_drive(context, find_drive(context, path));
                    }});
  routes.push_back({"DELETE", "/v1/maps/{map}/drives/{drive}",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return remove_drive(context, path);
                    },
                    Access::kWrite});
  add_drive_byte_routes(routes, context);
}

}  // namespace stillmap::server
