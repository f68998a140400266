#pragma once

#include "handlers/pose_handling.hpp"
#include "handlers/scan_in_request.hpp"
#include "handlers/set_maps.hpp"

#include <functional>
#include <optional>
#include <string>

/// What sessions of both kinds share: those that the server keeps and those that the client
/// carries.
namespace stillmap::server {

/// As `find_scan`, with the scan's time, and odometry that a tracker takes.
/// @throws ApiError for everything that is wrong with it.
[[nodiscard]] ScanInBody find_session_scan(const HttpRequest& request, const ServerOptions& options,
                                           ScanPurpose purpose);

/// A tracker, as a scan needs it, and until when.
struct ScanTracking {
  Thinner thin;
  std::function<SetTrackedPose(const ScanInSet&)> track;
  PoseClock::time_point deadline;
};
/// Decodes a scan and tracks it. Work: hold a ticket.
/// @param found  from `find_session_scan`. @param answer  is filled.
/// @throws ApiError as `decode_scan` and `require_wanted`.
void track_session_scan(const Context& context, const HttpRequest& request, ScanInBody&& found,
                        const ScanTracking& tracking, AlignmentQueue::Ticket& ticket,
                        PoseAnswer& answer);

/// What a vehicle gets now that names no version; nothing where no version is active, the active
/// one is broken or the map is gone: then a session keeps its own. @param vehicle  its label.
[[nodiscard]] std::optional<std::string> version_now(const MapCatalog& catalog,
                                                     const std::string& map,
                                                     const std::string& vehicle);
/// Whether this version of a map came with the roll-out that runs.
[[nodiscard]] bool is_rolled_out(const MapCatalog& catalog, const ServedVersion& map);

}  // namespace stillmap::server
