#include "pose_graph/first_placement.hpp"

#include <stillmap/maps/median.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include "pose_graph/graph_checks.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <map>
#include <random>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Of three positions each; with half of them wrong, two graphs in a million meet no right three.
constexpr std::size_t kDraws = 100;
/// Measurements that a placement is judged by; more would say the same.
constexpr std::size_t kJudges = 400;
/// An angle counts as the distance that it makes at this range [m]: a turned part is no good start.
constexpr double kRangeM = 20.0;
/// Weight of up, as a share of the spread: decides only what positions leave open.
constexpr double kUpShare = 1e-3;

/// Something absolute: where a point of the part, and perhaps the frame around it, is in the map.
struct Anchor {
  Eigen::Isometry3d T_part = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_map = Eigen::Isometry3d::Identity();
  bool has_rotation = false;
};

double distance_m(const Anchor& anchor, const Eigen::Isometry3d& T_map_part) {
  const Eigen::Isometry3d T = anchor.T_map.inverse() * T_map_part * anchor.T_part;
  const double angle_rad = anchor.has_rotation ? Eigen::AngleAxisd(T.linear()).angle() : 0.0;
  return T.translation().norm() + kRangeM * angle_rad;
}

double median_distance_m(const std::vector<Anchor>& anchors, const Eigen::Isometry3d& T_map_part) {
  std::vector<double> distances;
  const std::size_t step = anchors.size() / kJudges + 1;
  for (std::size_t i = 0; i < anchors.size(); i += step)
    distances.push_back(distance_m(anchors[i], T_map_part));
  return maps::median(std::move(distances));
}

/// Least squares over positions: Horn, "Closed-form solution of absolute orientation using unit
/// quaternions", 1987, by singular values as in Umeyama, 1991, without scale.
Eigen::Isometry3d fitted(const std::vector<const Anchor*>& anchors) {
  Eigen::Vector3d mean_part = Eigen::Vector3d::Zero(), mean_map = Eigen::Vector3d::Zero();
  for (const Anchor* anchor : anchors) {
    mean_part += anchor->T_part.translation() / static_cast<double>(anchors.size());
    mean_map += anchor->T_map.translation() / static_cast<double>(anchors.size());
  }
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  double spread = 0.0;
  for (const Anchor* anchor : anchors) {
    const Eigen::Vector3d part = anchor->T_part.translation() - mean_part;
    H += (anchor->T_map.translation() - mean_map) * part.transpose();
    spread += part.squaredNorm();
  }
  H(2, 2) += kUpShare * std::max(spread, 1e-6);
  const maps::SingularValues svd = maps::svd_of(H);
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();
  if ((svd.U * svd.V.transpose()).determinant() < 0.0) signs.z() = -1.0;
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.linear() = svd.U * signs.asDiagonal() * svd.V.transpose();
  out.translation() = mean_map - out.linear() * mean_part;
  return out;
}

/// The nearer half of the measurements decides, again and again.
Eigen::Isometry3d refined(const std::vector<Anchor>& anchors, Eigen::Isometry3d T_map_part) {
  for (int round = 0; round < 5; ++round) {
    const double bound_m = median_distance_m(anchors, T_map_part);
    std::vector<const Anchor*> near;
    for (const Anchor& anchor : anchors)
      if (distance_m(anchor, T_map_part) <= bound_m) near.push_back(&anchor);
    if (near.size() < 3) break;
    T_map_part = fitted(near);
  }
  return T_map_part;
}

Eigen::Isometry3d placed_by_anchors(const std::vector<Anchor>& anchors) {
  std::vector<Eigen::Isometry3d> tries{Eigen::Isometry3d::Identity()};
  std::mt19937_64 random(1);
  std::vector<const Anchor*> poses;
  for (const Anchor& anchor : anchors)
    if (anchor.has_rotation) poses.push_back(&anchor);
  for (std::size_t draw = 0; draw < kDraws; ++draw) {
    const auto any = [&] { return &anchors[random() % anchors.size()]; };
    tries.push_back(fitted({any(), any(), any()}));
    if (poses.empty()) continue;
    const Anchor* pose = poses[random() % poses.size()];
    tries.push_back(pose->T_map * pose->T_part.inverse());
  }
  std::pair<double, Eigen::Isometry3d> best{std::numeric_limits<double>::infinity(), tries.front()};
  const auto judge = [&](const Eigen::Isometry3d& T_map_part) {
    const double median_m = median_distance_m(anchors, T_map_part);
    if (median_m < best.first) best = {median_m, T_map_part};
  };
  for (const Eigen::Isometry3d& T_map_part : tries) judge(T_map_part);
  if (poses.empty()) judge(refined(anchors, best.second));
  return best.second;
}

struct Parts {
  /// Of each node; parts are named by their first node.
  std::vector<std::size_t> part_of;
  std::map<std::size_t, std::vector<Anchor>> anchors;
  /// T_map_part, of those that are placed; a part's own frame is that of its first guesses.
  std::map<std::size_t, Eigen::Isometry3d> placed;

  explicit Parts(const PoseGraph& graph) {
    JoinedSets sets(graph.nodes.size());
    for (const RelativePose& edge : graph.relative_poses)
      if (!edge.doubtful) sets.join(edge.from, edge.to);
    for (std::size_t i = 0; i < graph.nodes.size(); ++i) part_of.push_back(sets.set_of(i));
    for (const AbsolutePose& pose : graph.absolute_poses)
      anchors[part_of[pose.node]].push_back({graph.nodes[pose.node], pose.T_map_node, true});
    for (const AbsolutePosition& position : graph.absolute_positions) {
      Anchor anchor;
      anchor.T_part.translation() = graph.nodes[position.node] * position.lever_node_m;
      anchor.T_map.translation() = position.position_map_m;
      anchors[part_of[position.node]].push_back(anchor);
    }
  }
};

/// The placement of a part that a doubtful edge to a placed one tells.
struct Vote {
  std::size_t part = 0;
  /// Of the edge's node in the part.
  Eigen::Isometry3d T_part_node = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_map_part = Eigen::Isometry3d::Identity();
};

std::vector<Vote> votes_of(const PoseGraph& graph, const Parts& parts) {
  std::vector<Vote> out;
  const auto vote = [&](std::size_t known, std::size_t open,
                        const Eigen::Isometry3d& T_known_open) {
    const auto at = parts.placed.find(parts.part_of[known]);
    if (at == parts.placed.end() || parts.placed.contains(parts.part_of[open])) return;
    out.push_back({parts.part_of[open], graph.nodes[open],
                   at->second * graph.nodes[known] * T_known_open * graph.nodes[open].inverse()});
  };
  for (const RelativePose& edge : graph.relative_poses) {
    vote(edge.from, edge.to, edge.T_from_to);
    vote(edge.to, edge.from, edge.T_from_to.inverse());
  }
  return out;
}

/// Places the part with the most votes by the one that the others agree with best.
/// @return whether there was any.
bool place_next(const PoseGraph& graph, Parts& parts) {
  std::map<std::size_t, std::vector<Vote>> by_part;
  for (const Vote& vote : votes_of(graph, parts)) by_part[vote.part].push_back(vote);
  if (by_part.empty()) return false;
  const auto& [part, votes] =
      *std::ranges::max_element(by_part, {}, [](const auto& entry) { return entry.second.size(); });
  std::vector<Anchor> anchors;
  for (const Vote& vote : votes)
    anchors.push_back({vote.T_part_node, vote.T_map_part * vote.T_part_node, true});
  std::pair<double, Eigen::Isometry3d> best{std::numeric_limits<double>::infinity(),
                                            votes.front().T_map_part};
  const std::size_t step = votes.size() / kJudges + 1;
  for (std::size_t i = 0; i < votes.size(); i += step) {
    const double median_m = median_distance_m(anchors, votes[i].T_map_part);
    if (median_m < best.first) best = {median_m, votes[i].T_map_part};
  }
  parts.placed[part] = best.second;
  return true;
}

}  // namespace

std::vector<Eigen::Isometry3d> first_placement(const PoseGraph& graph) {
  if (graph.nodes.empty()) return {};
  Parts parts(graph);
  for (const auto& [part, anchors] : parts.anchors) parts.placed[part] = placed_by_anchors(anchors);
  if (parts.placed.empty()) parts.placed[parts.part_of.front()] = Eigen::Isometry3d::Identity();
  while (place_next(graph, parts)) continue;
  std::vector<Eigen::Isometry3d> out;
  out.reserve(graph.nodes.size());
  for (std::size_t i = 0; i < graph.nodes.size(); ++i)
    out.push_back(parts.placed.at(parts.part_of[i]) * graph.nodes[i]);
  return out;
}

}  // namespace stillmap::mapping
