#pragma once

#include "handlers/context.hpp"
#include "pose/pose_answer.hpp"
#include "pose/set_poses.hpp"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// The maps that a request which names none may be answered from.
namespace stillmap::server {

/// The sets that the caller may know of, each with the maps that its key may be used for.
[[nodiscard]] std::vector<MapSet> seen_sets(const Context& context, const Caller& caller);
/// Of these the one of this name, or the only one that there is.
/// @param name  empty: none was told. @param may_be_anywhere  whether all maps with a place on the
/// Earth will do where there is not one set: there is a satellite fix.
/// @throws ApiError kUnknownSet; kInvalidRequest when it must be named; kForbidden when the key is
/// for no map with a place on the Earth.
[[nodiscard]] MapSet wanted_set(const Context& context, const Caller& caller,
                                const std::string& name, bool may_be_anywhere = false);
/// The maps of such a set in the version that the vehicle gets.
/// @throws ApiError when none can be asked: why the first one cannot.
[[nodiscard]] SetOfRequest maps_of(const Context& context, const MapSet& set,
                                   const std::string& vehicle);
/// What a scan without a seal may take at most in a set: it may be looked for in so many maps.
[[nodiscard]] int units_in(const MapSet& set, WorkKind kind);

/// `prior`, `gnss` or `nothing`: what a map was chosen by.
[[nodiscard]] std::string_view name_of(const PlaceInSet& place);
/// Fills in of which map the answer is.
void set_map(PoseAnswer& answer, const SetOfRequest& set, const ServedVersion& map);

}  // namespace stillmap::server
