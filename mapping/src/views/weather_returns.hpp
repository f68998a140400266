#pragma once

#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <span>
#include <vector>

namespace stillmap::mapping {

/// Finds the returns of rain, snow and spray in one scan: single points in the air.
///
/// A return is alone when, of the directions within a degree of its own, fewer than two others have
/// a return near its range. Whether it rains is told by those that are alone and whose neighbours
/// passed them, eight directions or more with a return beyond: leaves and wires are so now and then
/// too, in clear weather some 0.1 % of what is nearer than 15 m (64 lasers). Where these are no
/// more than 1 %, nothing is flagged. Sensors of 16 lasers, whose rings are 2 degrees apart, see
/// too few ways around a return for it: their rain stays. In rain, all that is alone within 25 m
/// is: drops before everything else keep detectors from finding cars and views from seeing free
/// space.
/// @param positions  N points in the lidar frame [m], finite.
/// @return N flags, true = weather; empty in clear weather.
/// @see Charron, Phillips, Waslander, "De-noising of Lidar Point Clouds Corrupted by Snowfall", CRV
/// 2018 (few neighbours within a radius that grows with range). We ask for returns beyond as well,
/// since the sparse returns of a far or slanted surface have few neighbours.
[[nodiscard]] std::vector<bool> find_weather_returns(std::span<const Eigen::Vector3f> positions);
/// The same for each of the lidars that took the points, from where it stands.
[[nodiscard]] std::vector<bool> find_weather_of_lidars(const maps::PointCloud& cloud);

}  // namespace stillmap::mapping
