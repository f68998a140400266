#pragma once

#include "pose_graph/pose_graph.hpp"

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// Which things hang together.
class JoinedSets {
 public:
  explicit JoinedSets(std::size_t size);
  void join(std::size_t a, std::size_t b);
  /// The same number for all that hang together: the smallest of theirs.
  [[nodiscard]] std::size_t set_of(std::size_t member);

 private:
  std::vector<std::size_t> parents_;
};

/// @throws std::invalid_argument as `solve`, all but the parts.
void check_values(const PoseGraph& graph);

/// @throws std::invalid_argument naming a node that neither an edge nor anything absolute joins to
/// the first one.
void check_joined(const PoseGraph& graph);

}  // namespace stillmap::mapping
