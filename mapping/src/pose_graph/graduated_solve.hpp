#pragma once

#include "pose_graph/graph_problem.hpp"

namespace stillmap::mapping {

/// Minimum with doubtful measurements under a Geman-McClure loss, by graduated non-convexity: Yang,
/// Antonante, Tzoumas, Carlone, "Graduated Non-Convexity for Robust Spatial Perception", RA-L 2020.
GraphProblem::Outcome solve_graduated(const PoseGraph& graph, GraphProblem& problem,
                                      const CancelFlag& cancel);

}  // namespace stillmap::mapping
