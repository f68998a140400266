#pragma once

#include "fusion/object_fusion.hpp"
#include "fusion/obstacle_store.hpp"
#include "fusion/standing_shape.hpp"

#include <Eigen/Core>

#include <vector>

namespace stillmap::mapping {

/// Log odds that what stands there is a vehicle, from its shape and from what fusion knows of it;
/// for a class that is no vehicle, minus infinity.
/// @param scans  of its drive.
[[nodiscard]] double vehicle_log_odds(const FusedObject& object, const StandingShape& shape,
                                      std::size_t scans);

/// Asks all scans of a drive together about what a detector that goes by the shape in single scans
/// found: objects that stand and are no vehicle become doubtful, and doubtful ones that are become
/// objects. What moved stays as it is.
///
/// Standing things of a person's size are posts, trunks and bins far more often than people; they
/// are objects only where their place was seen free before or after.
/// @param scans   as fusion got them. @param count_rays  the same.
/// @param origin  of the local frame of the obstacles, in the map frame [m].
void judge_standing(FusedObjects& fused, const ObstacleStore& obstacles,
                    const std::vector<DetectedScan>& scans, const BoxRayCounter& count_rays,
                    const Eigen::Vector3d& origin);

}  // namespace stillmap::mapping
