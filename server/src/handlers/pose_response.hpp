#pragma once

#include "bodies/geopose_json.hpp"
#include "context.hpp"
#include "pose/pose_answer.hpp"

#include <optional>

/// In which form a pose is answered: JSON with all that is known, or OGC GeoPose.
namespace stillmap::server {

/// Forms that a request takes, by its header Accept.
struct PoseForms {
  /// Preferred to JSON.
  std::optional<GeoPoseTarget> geopose;
  /// Whether JSON is taken where there is no GeoPose.
  bool json = true;
};

/// GeoPose is chosen only when Accept names `application/geopose+json` with at least the weight of
/// JSON; a header that does not name it means JSON, whatever else it says.
/// @throws ApiError kNotAcceptable when the map has no place on the Earth, or the version or
/// profile is not known, and JSON is not taken instead.
[[nodiscard]] PoseForms pose_forms(const HttpRequest& request, const ServedVersion& map);
/// For answers that have no GeoPose. @throws ApiError kNotAcceptable.
void require_json_taken(const HttpRequest& request);

/// The answer in the form that was asked for; asked for as GeoPose it has `Stillmap-Status` and
/// `Stillmap-Reasons`. A lost one has no GeoPose: JSON where that is taken, else a problem, NoPose.
/// @param forms  from `pose_forms` with the same map.
[[nodiscard]] HttpResponse pose_response(const PoseAnswer& answer, const PoseForms& forms,
                                         const ServedVersion& map);

}  // namespace stillmap::server
