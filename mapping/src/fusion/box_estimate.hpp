#pragma once

#include "fusion/track.hpp"

#include <stillmap/maps/box.hpp>

#include <Eigen/Core>

#include <vector>

namespace stillmap::mapping {

/// The class most hits say, by their scores.
[[nodiscard]] maps::ObjectClass class_of(const std::vector<Hit>& hits);

/// Length, width, height that hits of one object agree on: a hit that saw one corner is short, so a
/// high quantile of each, over the hits nearest to the sensor.
[[nodiscard]] Eigen::Vector3d size_of(const std::vector<Hit>& hits);

/// A hit's centre for an object of `size_m`: each side that faced the sensor stays where it was
/// seen, and the one opposite of it, which was guessed, moves. From above [m].
[[nodiscard]] Eigen::Vector2d aligned_centre(const Hit& hit, const Eigen::Vector3d& size_m);

/// The box of an object that stood still.
///
/// Each side is the weighted median of where the hits saw it, those that faced it counting most: a
/// car that was first seen from behind and then from the front gets its rear from the former and
/// its front from the latter.
/// @param hits  at least one. Any order.
[[nodiscard]] maps::Box standing_box(const std::vector<Hit>& hits);

/// The value below which a share `q` in [0, 1] of the weight lies. Equal for any order.
/// @param values  value and weight, at least one.
[[nodiscard]] double weighted_quantile(std::vector<std::pair<double, double>> values, double q);

}  // namespace stillmap::mapping
