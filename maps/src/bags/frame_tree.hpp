#pragma once

#include <Eigen/Geometry>

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::maps {

/// Which frames stand in which, out of tf and tf_static. Rigid ones have their transform; of moving
/// ones only that they are.
class FrameTree {
 public:
  /// Frames on one way up; robots have a dozen. What lies above counts as not joined.
  static constexpr std::size_t kMostSteps = 64;

  /// The latest of a child counts. A frame that stands in itself is left out.
  /// @throws InputError naming `source` for over 4096 frames.
  void add_rigid(const std::string& parent, const std::string& child,
                 const Eigen::Isometry3d& T_parent_child, const std::string& source);
  /// @param T_parent_child  of this message; none where it cannot be read.
  void add_moving(const std::string& parent, const std::string& child,
                  const std::optional<Eigen::Isometry3d>& T_parent_child,
                  const std::string& source);
  /// Makes moving transforms rigid that came at least three times and never changed, as tf's old
  /// static_transform_publisher sends a mount. A transform whose parent is fixed to the ground
  /// (`stands_still`) stays moving: the vehicle may have been parked.
  /// @return the children of these transforms.
  std::vector<std::string> settle_unmoved();

  /// Through rigid ones alone, up and down. @return nothing when they are not joined by these.
  [[nodiscard]] std::optional<Eigen::Isometry3d> T_between(const std::string& to,
                                                           const std::string& from) const;
  /// A frame and those above it, one after the other up to the root.
  struct Step {
    std::string parent;
    std::string child;
    /// Nothing for a moving one.
    std::optional<Eigen::Isometry3d> T_parent_child;
  };
  /// @return steps from `frame` upward; empty when nothing is above it, or where they go in
  /// circles.
  [[nodiscard]] std::vector<Step> steps_above(const std::string& frame) const;
  /// Children of moving transforms whose parent is joined rigidly to `frame`, or is `frame`.
  [[nodiscard]] std::vector<std::string> moving_below(const std::string& frame) const;
  /// "base_link, lidar, odom" of all frames, at most 40.
  [[nodiscard]] std::string names() const;
  [[nodiscard]] bool has_rigid(const std::string& frame) const;

 private:
  struct Edge {
    std::string parent;
    /// Of rigid ones.
    std::optional<Eigen::Isometry3d> T_parent_child;
    /// Of moving ones: the first transform, until another one comes.
    std::optional<Eigen::Isometry3d> T_unmoved{};
    std::size_t messages = 1;
  };
  void add(const std::string& child, Edge edge, const std::string& source);
  /// A frame and the rigid ones above it, each with T_ancestor_frame.
  [[nodiscard]] std::vector<std::pair<std::string, Eigen::Isometry3d>> rigid_above(
      const std::string& frame) const;
  /// By child.
  std::map<std::string, Edge> edges_;
};

/// Whether a frame has a name of one that is fixed to the ground: map, odom, world,
/// camera_init or earth.
[[nodiscard]] bool stands_still(const std::string& frame);
/// The same without earth, whose axes are not a map's.
[[nodiscard]] bool is_map_frame(const std::string& frame);

}  // namespace stillmap::maps
