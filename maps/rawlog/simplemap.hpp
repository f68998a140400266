#pragma once

#include <cstdio>
#include <string>

namespace stillmap::maps::rawlog {

/// Writes keyframes (`RawlogRecord` of kind kKeyframe with their points, then kEnd) as an
/// `mrpt::maps::CSimpleMap`: each a pose without a covariance, since a map package keeps none, and
/// one `CObservationPointCloud` of a sensor at the vehicle's origin. Holds all of it in memory,
/// some 16 bytes a point. Same records, same bytes.
/// @throws std::runtime_error with the reason when the records break off or the file cannot be
/// written.
void write_simplemap(std::FILE* records, const std::string& file);

}  // namespace stillmap::maps::rawlog
