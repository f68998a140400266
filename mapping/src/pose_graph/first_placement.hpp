#pragma once

#include "pose_graph/pose_graph.hpp"

#include <Eigen/Geometry>

#include <vector>

namespace stillmap::mapping {

/// First guesses moved to where the graph can be solved from: Newton's steps find the minimum only
/// from the right side of it, and odometry starts in a frame of its own.
///
/// Nodes that trusted edges join keep their shape and move together. What knows most about the map
/// comes first: a part with absolute measurements goes where half of them fit best (least median of
/// distances over deterministic draws: poses alone, or three positions by Horn's method; Rousseeuw,
/// "Least Median of Squares Regression", 1984); as given when nothing fits better. Parts without
/// any follow along the doubtful edges to those that are placed, by the edge that most others agree
/// with. What positions leave open, the turn about a straight line, leaves up as it was.
/// @param graph  checked and joined.
[[nodiscard]] std::vector<Eigen::Isometry3d> first_placement(const PoseGraph& graph);

}  // namespace stillmap::mapping
