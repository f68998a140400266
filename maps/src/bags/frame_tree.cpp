#include "bags/frame_tree.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <array>
#include <set>
#include <string_view>
#include <utility>

namespace stillmap::maps {
namespace {

constexpr std::size_t kMostFrames = 4096;
constexpr std::size_t kMostNamed = 40;
/// A transform that is sent again is the same but for its last digits.
constexpr double kSame = 1e-9;
constexpr std::size_t kLeastRepeated = 3;
/// Frames of maps, by REP 105 and by use (LOAM and FAST-LIO begin in camera_init). Above them
/// stands the Earth, whose z is not up.
constexpr std::array<std::string_view, 4> kMapFrames{"map", "odom", "world", "camera_init"};
constexpr std::string_view kEarthFrame = "earth";

}  // namespace

void FrameTree::add(const std::string& child, Edge edge, const std::string& source) {
  if (edge.parent == child) return;
  if (edges_.size() == kMostFrames && !edges_.contains(child))
    throw InputError(source, "over " + std::to_string(kMostFrames) + " frames in tf", "fewer");
  edges_.insert_or_assign(child, std::move(edge));
}

void FrameTree::add_rigid(const std::string& parent, const std::string& child,
                          const Eigen::Isometry3d& T_parent_child, const std::string& source) {
  add(child, {parent, T_parent_child}, source);
}

void FrameTree::add_moving(const std::string& parent, const std::string& child,
                           const std::optional<Eigen::Isometry3d>& T_parent_child,
                           const std::string& source) {
  const auto known = edges_.find(child);
  if (known == edges_.end() || known->second.parent != parent)
    return add(child, {parent, std::nullopt, T_parent_child}, source);
  Edge& edge = known->second;
  // Some publish what is rigid as moving too.
  if (edge.T_parent_child || !T_parent_child) return;
  ++edge.messages;
  if (edge.T_unmoved &&
      !((edge.T_unmoved->matrix() - T_parent_child->matrix()).cwiseAbs().maxCoeff() <= kSame))
    edge.T_unmoved.reset();
}

std::vector<std::string> FrameTree::settle_unmoved() {
  std::vector<std::string> settled;
  for (auto& [child, edge] : edges_) {
    if (edge.T_parent_child || !edge.T_unmoved || edge.messages < kLeastRepeated ||
        stands_still(edge.parent))
      continue;
    edge.T_parent_child = edge.T_unmoved;
    settled.push_back(child);
  }
  return settled;
}

std::vector<std::pair<std::string, Eigen::Isometry3d>> FrameTree::rigid_above(
    const std::string& frame) const {
  std::vector<std::pair<std::string, Eigen::Isometry3d>> above;
  Eigen::Isometry3d T_here_frame = Eigen::Isometry3d::Identity();
  std::string here = frame;
  while (above.size() <= kMostSteps) {
    above.emplace_back(here, T_here_frame);
    const auto edge = edges_.find(here);
    if (edge == edges_.end() || !edge->second.T_parent_child) return above;
    T_here_frame = *edge->second.T_parent_child * T_here_frame;
    here = edge->second.parent;
  }
  return above;  // too many, or in circles
}

std::optional<Eigen::Isometry3d> FrameTree::T_between(const std::string& to,
                                                      const std::string& from) const {
  const auto of_to = rigid_above(to);
  const auto of_from = rigid_above(from);
  for (const auto& [frame, T_common_from] : of_from) {
    const auto common =
        std::find_if(of_to.begin(), of_to.end(),
                     [&, name = frame](const auto& each) { return each.first == name; });
    if (common == of_to.end()) continue;
    // Exactly the identity, where nothing lies between them.
    if (to == from) return Eigen::Isometry3d::Identity();
    return renormalized(common->second.inverse() * T_common_from);
  }
  return std::nullopt;
}

std::vector<FrameTree::Step> FrameTree::steps_above(const std::string& frame) const {
  std::vector<Step> steps;
  for (std::string here = frame;;) {
    const auto edge = edges_.find(here);
    if (edge == edges_.end()) return steps;
    if (steps.size() == edges_.size()) return {};
    steps.push_back({edge->second.parent, here, edge->second.T_parent_child});
    here = edge->second.parent;
  }
}

std::vector<std::string> FrameTree::moving_below(const std::string& frame) const {
  std::vector<std::string> below;
  for (const auto& [child, edge] : edges_)
    if (!edge.T_parent_child && T_between(frame, edge.parent)) below.push_back(child);
  return below;
}

std::string FrameTree::names() const {
  std::set<std::string> names;
  for (const auto& [child, edge] : edges_) {
    names.insert(child);
    names.insert(edge.parent);
  }
  std::string text;
  std::size_t named = 0;
  for (const std::string& name : names) {
    if (named++ == kMostNamed) return text + " ...";
    text += (text.empty() ? "'" : ", '") + name.substr(0, 64) + "'";
  }
  return text.empty() ? "none" : text;
}

bool FrameTree::has_rigid(const std::string& frame) const {
  return std::any_of(edges_.begin(), edges_.end(), [&](const auto& each) {
    return each.second.T_parent_child && (each.first == frame || each.second.parent == frame);
  });
}

bool is_map_frame(const std::string& frame) {
  const std::string last = frame.substr(frame.find_last_of('/') + 1);
  return std::find(kMapFrames.begin(), kMapFrames.end(), last) != kMapFrames.end();
}

bool stands_still(const std::string& frame) {
  return is_map_frame(frame) || frame.substr(frame.find_last_of('/') + 1) == kEarthFrame;
}

}  // namespace stillmap::maps
