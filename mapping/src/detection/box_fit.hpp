#pragma once

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>

#include <vector>

namespace stillmap::mapping {

/// Moves and turns the boxes of vehicles to where their points are, and lets them reach around what
/// was measured, as annotators do. A network that has seen few points of a car knows that there is
/// one and how large cars are, but places it by some decimetres and degrees off.
///
/// For each vehicle on its own:
///  1. headings to choose from: its own, and those of sure vehicles within 30 m and square to
///     them, since vehicles in a street stand alike;
///  2. for each of them the rectangle of the box's size is moved as little as its points allow:
///     all of them inside, and half of the way of a face that the sensor sees to the points;
///  3. the one whose points lie closest to faces that the sensor sees (closeness as in Zhang et
///     al., "Efficient L-shape fitting for vehicle detection using laser scanners", IV 2017), which
///     moved and turned least and which most neighbours share, wins;
///  4. sides and roof grow to points up to 0.2 m beyond them.
/// Others, and vehicles of fewer than 5 points between 0.15 m over the underside and 0.3 m over the
/// roof, stay as they are. Score, class and the end that was said to be the front are kept.
///
/// @param boxes  lidar frame, of finite size, score in [0, 1].
/// @param cloud  of the scan they were found in; points that are not finite belong to no box.
/// @note Same input, same bits, for any number of threads.
void fit_to_points(std::vector<maps::Box>& boxes, const maps::PointCloud& cloud);

}  // namespace stillmap::mapping
