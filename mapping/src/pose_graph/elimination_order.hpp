#pragma once

#include "pose_graph/pose_graph.hpp"

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// An order in which eliminating the nodes of a graph fills few blocks of its factor: nested
/// dissection (George, 1973; CHOLMOD's with METIS). Where many drives cross the same streets, this
/// is where the minimum degree that Ceres takes otherwise fails (mapping/decisions/ceres.md).
/// @return all nodes, once each. @throws std::bad_alloc.
[[nodiscard]] std::vector<std::size_t> elimination_order(const PoseGraph& graph);

}  // namespace stillmap::mapping
