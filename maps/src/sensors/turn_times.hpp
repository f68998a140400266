#pragma once

#include <stillmap/maps/scan.hpp>

namespace stillmap::maps {

/// Gives the points of one turn their times [s] relative to the stamp, by the angle that the sensor
/// had turned since the first of them; which way it turns is seen from them. Nothing is given where
/// their order in the file is not that of one turn, as in files that hold laser by laser.
/// @param period_s  of a turn, > 0. @param stamp_at  share of the turn at which the stamp lies.
void set_turn_times(PointCloud& cloud, double period_s, double stamp_at);

}  // namespace stillmap::maps
