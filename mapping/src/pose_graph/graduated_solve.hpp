#pragma once

#include "pose_graph/graph_problem.hpp"

namespace stillmap::mapping {

/// The minimum under Geman-McClure's loss, mu of the graduated one coming down to 1 by and by, so
/// that first guesses far off (drift of metres at a loop of centimetres) lose no right measurement.
/// @throws Cancelled.
GraphProblem::Outcome solve_graduated(GraphProblem& problem, const CancelFlag& cancel);

}  // namespace stillmap::mapping
