#pragma once

#include "context.hpp"
#include "errors/api_error.hpp"
#include "pose/pose_answer.hpp"
#include "pose/pose_request.hpp"

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

/// What queries, batches and sessions share.
namespace stillmap::server {

using PoseClock = AlignmentQueue::Clock;

[[nodiscard]] double milliseconds_since(PoseClock::time_point begin);

/// The revision of a map, in answers about its active version. A client sends the newest one that
/// it has seen, so that no server answers it with what is older.
inline constexpr const char* kRevisionHeader = "Stillmap-Revision";
/// 0 without that header. @throws ApiError kInvalidRequest for what is no revision.
[[nodiscard]] std::int64_t seen_revision(const HttpRequest& request);
/// Unless the version was named.
void add_revision(HttpResponse& response, const ServedVersion& map);

/// The version that the path names, else the one that the vehicle of the query gets.
/// @throws as `MapCatalog::ready`; ApiError kInvalidRequest for what is no label or revision.
[[nodiscard]] ServedVersion ready_version(const Context& context, const HttpRequest& request,
                                          const PathParameters& path);
/// Whether that version can be asked for poses, before a body is read.
/// @throws ApiError as `ready_version`; what is the server's own fault is left to the handler.
void require_ready(const Context& context, const HttpRequest& request, const PathParameters& path);

/// @param method  empty = the default. @throws ApiError kUnknownMethod.
[[nodiscard]] const localization::Aligner& choose_aligner(const Aligners& aligners,
                                                          const std::string& method);

/// The prior as it came, or made of the satellite fix. @throws ApiError kNoGeodeticOrigin.
[[nodiscard]] std::optional<localization::Prior> prior_in(
    const ServedVersion& map, const std::optional<localization::Prior>& prior,
    const std::optional<GnssFix>& gnss);

/// Whether a method is none of those that are made for the road. @param method  empty: the default.
[[nodiscard]] bool is_reference(std::string_view method);
[[nodiscard]] WorkKind kind_of(const PoseParameters& parameters);

[[nodiscard]] PoseClock::time_point deadline_of(const Context& context, const HttpRequest& request,
                                                std::optional<std::chrono::milliseconds> deadline);
/// @throws ApiError kDeadlineExceeded.
void check_deadline(PoseClock::time_point deadline);
/// @throws ApiError kClientGone.
void require_client(const HttpRequest& request);
/// Looks whether work for a request is still of use: call it between steps that take long.
/// @throws ApiError kDeadlineExceeded, kClientGone.
void require_wanted(const HttpRequest& request, PoseClock::time_point deadline);

/// As far as the head tells it: parameters in a body are taken for the usual ones.
[[nodiscard]] WorkKind kind_in_head(const HttpRequest& request);
/// Room for a request with a scan, by its head alone; goes into `HttpRequest::reservation`.
/// @param units  scans in it. @throws ApiError kBusy, kTooManyRequests.
[[nodiscard]] std::shared_ptr<void> reserve_room(const Context& context, const HttpRequest& request,
                                                 WorkKind kind, int units);
[[nodiscard]] const AlignmentQueue::Reservation& reservation_of(const HttpRequest& request);
/// Bytes that the body will take.
[[nodiscard]] std::size_t body_bytes(const Context& context, const HttpRequest& request);

/// How an aligner or a session thins a scan.
using Thinner = std::function<localization::ThinScan(const localization::ScanView&)>;
/// What is matched of a request's scan. Points in movable boxes are left out and counted. Work:
/// hold a ticket.
/// @throws ApiError for a scan that was thinned for another vehicle, or with boxes beside it.
[[nodiscard]] localization::ThinScan scan_to_match(PoseRequest& request, const Thinner& thin,
                                                   PoseAnswer& answer);
[[nodiscard]] PoseAnswer answer_for(const ServedVersion& map, const HttpRequest& request);
/// The same, for the vehicle and the version that a request names.
[[nodiscard]] PoseAnswer answer_for(const ServedVersion& map, const HttpRequest& request,
                                    const PathParameters& path);
/// Counts an answer, for its vehicle and for a roll-out too, which it may halt.
/// @param method  as it was asked for, one that there is.
void count_answer(const Context& context, const PoseAnswer& answer, const std::string& method);
/// The answer is about to be written: its total time, and the figures of its map.
void finish_answer(const Context& context, const HttpRequest& request, PoseAnswer& answer);
/// Runs `answer`, and counts what it refuses on this map.
template <typename Answer>
auto counting_refusals(const Context& context, const std::string& map, const Answer& answer) {
  try {
    return answer();
  } catch (const ApiError& error) {
    // A map that is not there has no figures, so that names from outside take no memory.
    if (error.code() != ErrorCode::kUnknownMap) context.stats.refused(map);
    throw;
  }
}
/// Compares the stamp, if there is one, with the server's clock.
void note_clock_skew(const Context& context, PoseAnswer& answer);

}  // namespace stillmap::server
