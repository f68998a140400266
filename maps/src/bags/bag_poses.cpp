#include "bags/bag_poses.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <string_view>
#include <utility>

#include "bags/ros_messages.hpp"

namespace stillmap::maps {
namespace {

/// A goal that was set now and then is no path.
constexpr std::size_t kLeastPoses = 2;
constexpr std::size_t kMostScansAPose = 40;
/// As the survey reads of tf.
constexpr std::size_t kMostPoseBytes = std::size_t{1} << 20U;

/// Frames that the messages of a topic of poses name.
struct FramesOfPoses {
  std::optional<std::string> parent;
  std::optional<std::string> child;
  /// Parent and child of the first one that has others.
  std::string other;
  std::size_t invalid = 0;

  void add(const StampedTransform& pose) {
    if (!parent) {
      parent = pose.parent;
      child = pose.child;
    } else if (other.empty() && (*parent != pose.parent || *child != pose.child)) {
      other = fmt::format("'{}' in '{}'", pose.child, pose.parent);
    }
    if (!pose.T_parent_child) ++invalid;
  }
};

/// From the frame that the poses are of to the cloud's.
Eigen::Isometry3d T_pose_cloud(const PoseSearch& search, const std::string& topic,
                               const std::string& child, std::vector<std::string>& notes) {
  const FrameTree& tree = search.survey.tree;
  const std::string& cloud = search.cloud_frame;
  if (!search.choice.pose_frame && child.empty() && !tree.has_rigid(cloud)) {
    notes.push_back(fmt::format("{} names no frame that its poses are of: taken as those of '{}'",
                                topic, cloud));
    return Eigen::Isometry3d::Identity();
  }
  const std::string frame = search.choice.pose_frame.value_or(child);
  if (frame.empty() && cloud != frame)
    throw InputError(
        search.name, fmt::format("poses on {} that name no frame", topic),
        fmt::format(
            "the name of the frame that moves: choose it, as in '{}?pose_frame={}'; frames are {}",
            search.name, cloud, tree.names()));
  if (frame == cloud) return Eigen::Isometry3d::Identity();
  if (const auto T = tree.T_between(frame, cloud)) return *T;
  throw InputError(
      search.name,
      fmt::format("no transform in tf_static from '{}' of the poses on {} to '{}' of the clouds; "
                  "frames are {}",
                  frame, topic, cloud, tree.names()),
      fmt::format("that transform: record tf_static too; if the poses are in truth those of '{1}', "
                  "give '{0}?pose_frame={1}'; to do without poses, '{0}?poses=none'",
                  search.name, cloud));
}

bool moves(const std::vector<FrameTree::Step>& steps) {
  return std::any_of(steps.begin(), steps.end(),
                     [](const auto& step) { return !step.T_parent_child; });
}

BagPoses poses_of_tf(const PoseSearch& search, const std::vector<FrameTree::Step>& steps) {
  std::map<std::size_t, PosesNearScans> near;
  for (std::size_t i = 0; i < steps.size(); ++i)
    if (!steps[i].T_parent_child) near.emplace(i, search.stamps_ns);
  visit_messages(
      search.bags, kMostPoseBytes,
      [](const BagTopic& topic) { return topic.type == kTfMessage && !is_static_tf(topic.name); },
      [&](MessageReader& reader, const BagTopic&) {
        read_transforms(reader, [&](const StampedTransform& transform) {
          if (!transform.T_parent_child) return;
          for (auto& [i, poses] : near)
            if (steps[i].child == transform.child && steps[i].parent == transform.parent)
              poses.add(transform.stamp_ns, *transform.T_parent_child);
        });
      });
  BagPoses poses;
  poses.source = fmt::format("tf from '{}' to '{}'", steps.back().parent, search.cloud_frame);
  for (std::size_t i = steps.size(); i-- > 0;) {
    if (steps[i].T_parent_child) {
      poses.factors.push_back({{}, *steps[i].T_parent_child});
      continue;
    }
    if (near.at(i).added() == 0)
      throw InputError(search.name,
                       fmt::format("no transform from '{}' to '{}' that can be read",
                                   steps[i].parent, steps[i].child),
                       "transforms: choose a topic of poses with poses=TOPIC, or poses=none");
    poses.factors.push_back({near.at(i).trajectory(), {}});
  }
  return poses;
}

/// Clouds in the frame that the poses are given in, as SLAM publishes registered scans.
std::optional<Eigen::Isometry3d> T_parent_cloud(const PoseSearch& search, const std::string& parent,
                                                const std::string& child) {
  if (parent.empty()) return std::nullopt;
  const FrameTree& tree = search.survey.tree;
  if (!child.empty() && child != parent && tree.T_between(child, search.cloud_frame))
    return std::nullopt;
  return tree.T_between(parent, search.cloud_frame);
}

/// Poses of each are kept beside the scans.
void require_few(const PoseSearch& search, const std::vector<FrameTree::Step>& steps) {
  if (steps.size() <= FrameTree::kMostSteps) return;
  throw InputError(search.name,
                   fmt::format("{} frames above '{}' in tf", steps.size(), steps.front().child),
                   fmt::format("at most {}: choose another topic of poses with poses=TOPIC, or "
                               "poses=none",
                               FrameTree::kMostSteps));
}

/// Steps of tf from a frame up to the first that is joined rigidly to that of the clouds; empty if
/// there is none, or nothing moves between them.
std::vector<FrameTree::Step> steps_to_clouds(const PoseSearch& search, const std::string& frame) {
  const FrameTree& tree = search.survey.tree;
  std::vector<FrameTree::Step> steps = tree.steps_above(frame);
  const auto top = std::find_if(steps.begin(), steps.end(), [&](const FrameTree::Step& step) {
    return tree.T_between(step.parent, search.cloud_frame).has_value();
  });
  if (top == steps.end()) return {};
  steps.erase(std::next(top), steps.end());
  if (!moves(steps)) return {};
  require_few(search, steps);
  return steps;
}

/// Poses of a frame that moves in that of registered clouds.
BagPoses poses_of_tf_below(const PoseSearch& search, const std::vector<FrameTree::Step>& steps) {
  BagPoses poses = poses_of_tf(search, steps);
  poses.moving_frame = steps.front().child;
  poses.source = fmt::format("tf from '{}' to '{}'", steps.back().parent, poses.moving_frame);
  poses.T_map_points = search.survey.tree.T_between(steps.back().parent, search.cloud_frame);
  return poses;
}

BagPoses poses_of_topic(const PoseSearch& search, const std::string& topic) {
  PosesNearScans near(search.stamps_ns);
  FramesOfPoses frames;
  visit_messages(
      search.bags, kMostPoseBytes, [&](const BagTopic& each) { return each.name == topic; },
      [&](MessageReader& reader, const BagTopic& each) {
        const StampedTransform pose = read_pose(reader, each.type);
        frames.add(pose);
        if (pose.T_parent_child) near.add(pose.stamp_ns, *pose.T_parent_child);
      });
  if (!frames.other.empty())
    throw InputError(
        search.name,
        fmt::format("poses of '{}' in '{}' and {} on {}", *frames.child, *frames.parent,
                    frames.other, topic),
        "one frame in one other: choose another topic with poses=TOPIC, or poses=none");
  BagPoses poses;
  poses.source = topic;
  if (frames.invalid > 0)
    poses.notes.push_back(fmt::format(
        "{} poses of {} left out, which are not finite or no rotation", frames.invalid, topic));
  if (near.added() == 0)
    throw InputError(search.name, fmt::format("no poses on {} that can be read", topic),
                     "poses: choose another topic with poses=TOPIC, or poses=none");
  poses.factors.push_back({near.trajectory(), {}});
  std::string child = search.choice.pose_frame.value_or(frames.child.value_or(""));
  if (child == frames.parent.value_or("")) child = frames.child.value_or("");
  poses.T_map_points = T_parent_cloud(search, frames.parent.value_or(""), child);
  if (poses.T_map_points) {
    poses.moving_frame = child;
    return poses;
  }
  if (const auto steps = steps_to_clouds(search, child);
      !child.empty() && !steps.empty() && !search.survey.tree.T_between(child, search.cloud_frame))
    return poses_of_tf_below(search, steps);
  const Eigen::Isometry3d T = T_pose_cloud(search, topic, frames.child.value_or(""), poses.notes);
  if (!T.matrix().isIdentity(0.0)) poses.factors.push_back({{}, T});
  return poses;
}

/// From the cloud's frame up to the highest that is named as a map's, else to the root: what stands
/// above a map (the Earth's centre, a zone of UTM) has other axes.
std::vector<FrameTree::Step> steps_to_map(const PoseSearch& search) {
  std::vector<FrameTree::Step> steps = search.survey.tree.steps_above(search.cloud_frame);
  const auto highest = std::find_if(steps.rbegin(), steps.rend(),
                                    [](const auto& step) { return is_map_frame(step.parent); });
  if (highest != steps.rend()) steps.erase(highest.base(), steps.end());
  require_few(search, steps);
  return steps;
}

/// The frame whose motion tf gives in that of the clouds: the chosen one, or the only one, below
/// frames that are fixed to the ground.
std::optional<std::string> frame_below_clouds(const PoseSearch& search) {
  if (search.choice.pose_frame) return search.choice.pose_frame;
  std::string frame = search.cloud_frame;
  // Where frames stand in a circle there is no end.
  for (std::size_t step = 0; step < FrameTree::kMostSteps; ++step) {
    const std::vector<std::string> below = search.survey.tree.moving_below(frame);
    if (below.size() != 1) return std::nullopt;
    frame = below.front();
    if (!stands_still(frame)) return frame;
  }
  return std::nullopt;
}

/// Registered clouds, and tf alone: poses of what moves in their frame.
std::optional<BagPoses> find_tf_below(const PoseSearch& search, bool asked) {
  const std::optional<std::string> frame = frame_below_clouds(search);
  if (!frame) return std::nullopt;
  const std::vector<FrameTree::Step> steps = steps_to_clouds(search, *frame);
  if (steps.empty()) return std::nullopt;
  BagPoses poses = poses_of_tf_below(search, steps);
  poses.only_if_overlapping =
      !asked && !stands_still(search.cloud_frame) && !stands_still(steps.back().parent);
  return poses;
}

std::optional<BagPoses> find_tf(const PoseSearch& search, bool asked,
                                std::vector<std::string>& notes) {
  const std::vector<FrameTree::Step> steps = steps_to_map(search);
  if (!moves(steps))
    if (auto poses = find_tf_below(search, asked)) return poses;
  if (search.choice.pose_frame)
    throw InputError(search.name, "pose_frame without a topic of poses",
                     "a topic of poses beside it, as in poses=/odom&pose_frame=base_link");
  if (!moves(steps) && asked)
    throw InputError(search.name,
                     fmt::format("nothing in tf that moves '{}'; frames are {}", search.cloud_frame,
                                 search.survey.tree.names()),
                     "transforms from a fixed frame to that of the clouds: choose a topic of poses "
                     "with poses=TOPIC, or poses=none");
  if (!moves(steps)) return std::nullopt;
  if (asked || stands_still(steps.back().parent)) return poses_of_tf(search, steps);
  notes.push_back(
      fmt::format("tf is not used for poses: it moves '{}' in '{}', which has no name of a fixed "
                  "frame (map, odom, world, camera_init, earth); to use it, choose poses=/tf",
                  search.cloud_frame, steps.back().parent));
  return std::nullopt;
}

/// Topics of poses to choose from, and tf where it is another choice.
struct Candidates {
  std::vector<std::string> topics;
  std::string listed;

  void add(const std::string& topic, const std::string& what) {
    topics.push_back(topic);
    listed += fmt::format("{}{} ({})", listed.empty() ? "" : ", ", topic, what);
  }
};

Candidates topics_of_poses(const PoseSearch& search, std::vector<std::string>& notes) {
  Candidates found;
  for (const auto& [topic, known] : search.survey.topics) {
    if (!is_pose_type(known.type) || known.messages == 0) continue;
    const bool may_be_goals = known.type == kPoseStamped && !search.choice.pose_frame;
    if (known.messages >= kLeastPoses &&
        (!may_be_goals || known.messages * kMostScansAPose >= search.stamps_ns.size())) {
      found.add(topic, fmt::format("{} {}", known.messages, known.type));
      continue;
    }
    if (search.choice.poses) continue;
    notes.push_back(fmt::format(
        "{} is not used for poses: it has only {} for {} scans; to use it, choose poses={}", topic,
        known.messages, search.stamps_ns.size(), topic));
  }
  return found;
}

/// Whether tf says the same as a topic, but for constants: many who publish odometry send both, and
/// put a map that does not move above it.
bool is_also_in_tf(const FrameTree& tree, const std::optional<PoseFrames>& frames,
                   const std::vector<FrameTree::Step>& steps) {
  if (!frames || frames->child.empty()) return false;
  const auto parent = std::find_if(steps.begin(), steps.end(),
                                   [&](const auto& step) { return step.parent == frames->parent; });
  if (parent == steps.end() || moves({std::next(parent), steps.end()})) return false;
  return std::any_of(steps.begin(), std::next(parent), [&](const auto& step) {
    return tree.T_between(frames->child, step.child).has_value();
  });
}

/// Adds tf where a standing frame moves the clouds in it and the one topic says something else.
void add_tf(const PoseSearch& search, Candidates& found) {
  if (found.topics.empty()) return;
  const std::vector<FrameTree::Step> steps = steps_to_map(search);
  if (!moves(steps) || !stands_still(steps.back().parent) ||
      (found.topics.size() == 1 &&
       is_also_in_tf(search.survey.tree, search.survey.topics.at(found.topics.front()).pose_frames,
                     steps)))
    return;
  for (const auto& [topic, known] : search.survey.topics)
    if (known.type == kTfMessage && !is_static_tf(topic) && known.messages > 0)
      return found.add(
          topic, fmt::format("tf from '{}' to '{}'", steps.back().parent, search.cloud_frame));
}

/// Odometry would find no motion between scans that are registered already.
void require_unregistered(const PoseSearch& search) {
  if (search.choice.points) return;
  for (const auto& [topic, known] : search.survey.topics) {
    if (!known.pose_frames || known.messages < kLeastPoses ||
        !T_parent_cloud(search, known.pose_frames->parent, known.pose_frames->child))
      continue;
    throw InputError(
        search.name,
        fmt::format("poses=none, but clouds in '{}', the frame that the poses of {} are in: they "
                    "are registered already, and odometry would find no motion",
                    search.cloud_frame, topic),
        fmt::format("the poses of {}: leave poses=none out; if the points lie in the sensor's "
                    "frame, add points=sensor",
                    topic));
  }
}

}  // namespace

std::optional<Eigen::Isometry3d> BagPoses::T_map_lidar(std::int64_t stamp_ns) const {
  std::optional<Eigen::Isometry3d> T;
  for (const Factor& factor : factors) {
    Eigen::Isometry3d step = factor.rigid;
    if (factor.is_moving()) {
      const auto at = factor.moving.at(stamp_ns);
      if (!at) return std::nullopt;
      step = *at;
    }
    T = T ? renormalized(*T * step) : step;
  }
  return T;
}

std::optional<BagPoses> find_poses(const PoseSearch& search, std::vector<std::string>& notes) {
  const BagChoice& choice = search.choice;
  const BagSurvey& survey = search.survey;
  const std::string& name = search.name;
  if (choice.poses == "none") {
    require_unregistered(search);
    return std::nullopt;
  }
  Candidates candidates = topics_of_poses(search, notes);
  if (choice.poses) {
    const auto asked = survey.topics.find(*choice.poses);
    if (asked != survey.topics.end() && asked->second.type == kTfMessage)
      return find_tf(search, true, notes);
    if (asked != survey.topics.end() && is_pose_type(asked->second.type))
      return poses_of_topic(search, asked->first);
    throw InputError(name,
                     fmt::format("no poses on {}; there are {}", *choice.poses,
                                 candidates.listed.empty() ? "none" : candidates.listed),
                     fmt::format("a topic of {}, {} or {}, or poses=none", kNavOdometry,
                                 kPoseStamped, kTfMessage));
  }
  // Whoever says the frame that they are of speaks of a topic.
  if (!choice.pose_frame) add_tf(search, candidates);
  if (candidates.topics.size() > 1)
    throw InputError(name, "poses on " + candidates.listed,
                     fmt::format("one topic, chosen as in '{}?poses={}', or poses=none", name,
                                 candidates.topics.front()));
  if (candidates.topics.size() == 1) return poses_of_topic(search, candidates.topics.front());
  return find_tf(search, false, notes);
}

}  // namespace stillmap::maps
