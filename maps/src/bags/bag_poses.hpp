#pragma once

#include <stillmap/maps/trajectory.hpp>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "bags/bag_choice.hpp"
#include "bags/bag_survey.hpp"
#include "bags/poses_near_scans.hpp"

namespace stillmap::maps {

/// Where the poses of a bag come from: factors whose product, each at a scan's stamp, is
/// T_map_lidar. One moving factor for a topic of poses; for tf one for each moving transform.
struct BagPoses {
  struct Factor {
    /// Of moving ones.
    Trajectory moving;
    Eigen::Isometry3d rigid = Eigen::Isometry3d::Identity();
    [[nodiscard]] bool is_moving() const { return !moving.empty(); }
  };
  std::vector<Factor> factors;
  /// "/odom" and the like, for messages.
  std::string source;
  std::vector<std::string> notes;
  /// If the bag's frames say that the clouds are registered, in the frame of the poses or one that
  /// is joined to it: from their points to that of the poses.
  std::optional<Eigen::Isometry3d> T_map_points;
  /// The frame that moves, of registered clouds.
  std::string moving_frame;
  /// Only if the scans' overlap says that they are registered: the frames could mean other things.
  bool only_if_overlapping = false;

  /// @return nothing where one of the factors has no pose within 0.2 s.
  [[nodiscard]] std::optional<Eigen::Isometry3d> T_map_lidar(std::int64_t stamp_ns) const;
};

/// What is known of a bag where its poses are looked for.
struct PoseSearch {
  const Bags& bags;
  const BagSurvey& survey;
  const BagChoice& choice;
  /// Of the scans.
  const std::string& cloud_frame;
  const std::vector<std::int64_t>& stamps_ns;
  /// Of the drive, for messages.
  const std::string& name;
};

/// Chooses between topics of poses and tf (`Drive::open` says how) and goes through the bags a
/// second time for the poses around the scans.
/// @return nothing without poses; then a note is added where tf had some that are not taken.
/// @throws InputError naming what there is to choose from, or the frames when no chain of tf_static
/// leads from the poses' frame to the cloud's; StorageError.
[[nodiscard]] std::optional<BagPoses> find_poses(const PoseSearch& search,
                                                 std::vector<std::string>& notes);

}  // namespace stillmap::maps
