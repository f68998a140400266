#include "handlers/session_scan.hpp"

#include "errors/api_error.hpp"

#include <fmt/format.h>

#include "store/store_refusal.hpp"

#include <utility>

namespace stillmap::server {
namespace {

/// What `Tracker` would refuse, in the words of the interface.
void check_odometry(const PoseParameters& parameters) {
  constexpr double kMaxStepM = 1e5;
  const auto& step = parameters.odometry;
  if (!step) return;
  if (step->since_ns >= *parameters.stamp_ns) {
    throw field_error(ErrorCode::kInvalidOdometry, "odometry.since_ns",
                      std::to_string(step->since_ns), "a stamp before the scan's");
  }
  if (!(step->T_since_lidar.translation().cwiseAbs().maxCoeff() <= kMaxStepM)) {
    throw field_error(ErrorCode::kInvalidOdometry, "odometry.position", "a longer way",
                      fmt::format("at most {} m", kMaxStepM));
  }
}

}  // namespace

ScanInBody find_session_scan(const HttpRequest& request, const ServerOptions& options,
                             ScanPurpose purpose) {
  ScanInBody found = find_scan(request, options, purpose);
  if (!found.parameters.stamp_ns) {
    throw field_error(ErrorCode::kInvalidRequest, "stamp_ns", "nothing",
                      "the scan's time: a session orders its scans by it");
  }
  check_odometry(found.parameters);
  return found;
}

void track_session_scan(const Context& context, const HttpRequest& request, ScanInBody&& found,
                        const ScanTracking& tracking, AlignmentQueue::Ticket& ticket,
                        PoseAnswer& answer) {
  answer.timing.wait_ms = milliseconds_since(request.received);
  context.metrics.queue_waited(1e-3 * answer.timing.wait_ms);
  const PoseClock::time_point begin = PoseClock::now();
  require_wanted(request, tracking.deadline);
  PoseRequest pose_request = decode_scan(std::move(found), context.options);
  answer.timing.decode_ms = milliseconds_since(begin);
  const PoseClock::time_point aligning = PoseClock::now();
  const localization::ThinScan thinned = scan_to_match(pose_request, tracking.thin, answer);
  SetTrackedPose tracked = tracking.track(
      {.stamp_ns = *pose_request.parameters.stamp_ns,
       .scan_lidar = thinned,
       .odometry = pose_request.parameters.odometry,
       .require_wanted = [&] { require_wanted(request, tracking.deadline); },
       .matched =
           [&](const localization::TrackedPose& pose) {
             const bool everywhere = pose.searched_from == localization::SearchedFrom::kEverywhere;
             ticket.scan_done(everywhere ? WorkKind::kEverywhere : WorkKind::kNearPrior);
           }});
  localization::TrackedPose& pose = tracked.pose;
  answer.timing.align_ms = milliseconds_since(aligning);
  answer.handed_over_from = std::move(tracked.handed_over_from);
  if (!answer.handed_over_from.empty()) context.metrics.handed_over(answer.map_name);
  if (!tracked.not_shown_by.empty()) context.metrics.hand_over_refused(tracked.not_shown_by);
  answer.searched_from = pose.searched_from;
  answer.result = std::move(pose.result);
  answer.parameters = std::move(pose_request.parameters);
}

std::optional<std::string> version_now(const MapCatalog& catalog, const std::string& map,
                                       const std::string& vehicle) {
  try {
    return catalog.find_for(map, vehicle).version;
  } catch (const ApiError&) {
    return std::nullopt;
  } catch (const StoreRefusal&) {
    return std::nullopt;
  }
}

bool is_rolled_out(const MapCatalog& catalog, const ServedVersion& map) {
  const std::optional<Rollout> rollout = catalog.rollout(map.map);
  return rollout && rollout->version == map.version;
}

}  // namespace stillmap::server
