#pragma once

#include "handlers/context.hpp"
#include "pose/pose_answer.hpp"
#include "pose/set_poses.hpp"

#include <optional>
#include <string>
#include <vector>

/// The maps that a request which names none may be answered from.
namespace stillmap::server {

/// A set as a request may use it.
struct SetOfRequest {
  /// Empty: all maps with a place on the Earth.
  std::string name;
  /// The maps that can be asked now.
  std::vector<SetMap> maps;
  /// Why another one cannot: it is being loaded.
  std::optional<ApiError> loading;
};

/// The set of this name, or the only one that there is.
/// @param name  empty: none was told. @param may_be_anywhere  whether all maps with a place on the
/// Earth will do where there is not one set: there is a satellite fix.
/// @throws ApiError kUnknownSet; kInvalidRequest when it must be named.
[[nodiscard]] MapSet wanted_set(const Context& context, const std::string& name,
                                bool may_be_anywhere = false);
/// Of a set the maps that the caller's key may be used for, in the version that the vehicle gets.
/// What is broken or has no active version is left out.
/// @throws ApiError kForbidden when the key is for none of them; when none can be asked, why the
/// first one cannot.
[[nodiscard]] SetOfRequest maps_of(const Context& context, const Caller& caller, const MapSet& set,
                                   const std::string& vehicle);
/// As `server::candidates_in`.
/// @throws also ApiError kMapLoading when the scan may be in a map that is being loaded.
[[nodiscard]] SetCandidates candidates_in(const SetOfRequest& set, const PlaceInSet& place);

/// `prior`, `gnss` or `nothing`: what a map was chosen by.
[[nodiscard]] std::string_view name_of(const PlaceInSet& place);
/// Fills in of which map the answer is.
void set_map(PoseAnswer& answer, const SetOfRequest& set, const ServedVersion& map);

}  // namespace stillmap::server
