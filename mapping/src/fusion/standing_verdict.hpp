#pragma once

#include "fusion/object_fusion.hpp"
#include "fusion/obstacle_map.hpp"
#include "fusion/standing_shape.hpp"

#include <Eigen/Core>

namespace stillmap::mapping {

/// Log odds that what stands there is a vehicle, from its shape and from what fusion knows of it.
/// Things of a person's size that stand are posts, trunks and bins far more often than people, and
/// people walk on: minus infinity.
[[nodiscard]] double vehicle_log_odds(const FusedObject& object, const StandingShape& shape);

/// Asks all scans together what a detector that goes by the shape in single scans found: objects
/// that stand and are no vehicle become doubtful, and doubtful ones that are become objects.
/// Objects that moved stay as they are.
/// @param origin  of the local frame of the obstacles, in the map frame [m].
void judge_standing(FusedObjects& fused, const ObstacleMap& obstacles,
                    const Eigen::Vector3d& origin);

}  // namespace stillmap::mapping
