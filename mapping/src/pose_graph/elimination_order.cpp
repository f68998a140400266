#include "pose_graph/elimination_order.hpp"

#include <suitesparse/cholmod.h>

#include <algorithm>
#include <memory>
#include <new>

namespace stillmap::mapping {
namespace {

/// CHOLMOD's workspace.
class Workspace {
 public:
  Workspace() { cholmod_start(&common_); }
  ~Workspace() { cholmod_finish(&common_); }
  Workspace(const Workspace&) = delete;
  Workspace& operator=(const Workspace&) = delete;
  cholmod_common* get() { return &common_; }

 private:
  cholmod_common common_{};
};

}  // namespace

std::vector<std::size_t> elimination_order(const PoseGraph& graph) {
  Workspace workspace;
  const std::size_t nodes = graph.nodes.size();
  const auto free_pairs = [&](cholmod_triplet* each) {
    cholmod_free_triplet(&each, workspace.get());
  };
  const auto free_pattern = [&](cholmod_sparse* each) {
    cholmod_free_sparse(&each, workspace.get());
  };
  // Which nodes a measurement joins: the lower triangle of a symmetric matrix.
  const std::unique_ptr<cholmod_triplet, decltype(free_pairs)> pairs(
      cholmod_allocate_triplet(nodes, nodes, nodes + graph.relative_poses.size(), -1,
                               CHOLMOD_PATTERN, workspace.get()),
      free_pairs);
  if (pairs == nullptr) throw std::bad_alloc();
  const auto join = [&](std::size_t a, std::size_t b) {
    static_cast<int*>(pairs->i)[pairs->nnz] = static_cast<int>(std::max(a, b));
    static_cast<int*>(pairs->j)[pairs->nnz++] = static_cast<int>(std::min(a, b));
  };
  for (std::size_t node = 0; node < nodes; ++node) join(node, node);
  for (const RelativePose& edge : graph.relative_poses) join(edge.from, edge.to);
  const std::unique_ptr<cholmod_sparse, decltype(free_pattern)> pattern(
      cholmod_triplet_to_sparse(pairs.get(), 0, workspace.get()), free_pattern);
  if (pattern == nullptr) throw std::bad_alloc();
  std::vector<int> order(nodes), parents(nodes), members(nodes);
  if (cholmod_nested_dissection(pattern.get(), nullptr, 0, order.data(), parents.data(),
                                members.data(), workspace.get()) < 0)
    throw std::bad_alloc();
  return {order.begin(), order.end()};
}

}  // namespace stillmap::mapping
