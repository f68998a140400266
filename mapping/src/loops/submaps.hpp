#pragma once

#include "loops/keyframe_store.hpp"
#include "loops/odometry_path.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/mapping/progress.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <memory>
#include <vector>

namespace stillmap::mapping {

/// Map of a stretch of the path, in a frame with z up.
struct Submap {
  std::vector<std::size_t> keyframes;
  /// Of each of them.
  std::vector<Eigen::Isometry3d> T_submap_lidar;
  /// Null where too few points were seen for a map.
  std::unique_ptr<const localization::Aligner> aligner;

  /// @throws std::out_of_range for a keyframe that is not part of it.
  [[nodiscard]] const Eigen::Isometry3d& pose_of(std::size_t keyframe) const;
  /// The keyframe taken nearest to a place.
  [[nodiscard]] std::size_t nearest_to(const Eigen::Vector3d& p_submap) const;
};

/// Cuts the paths into overlapping stretches, and puts their scans together as odometry has them:
/// over so short a way it hardly drifts.
class Submaps {
 public:
  /// @param keyframes, path  of the same keyframes; outlive this.
  Submaps(const KeyframeStore& keyframes, const OdometryPath& path);

  [[nodiscard]] std::size_t size() const { return centres_.size(); }
  /// The keyframe in the middle.
  [[nodiscard]] std::size_t centre(std::size_t submap) const { return centres_[submap]; }
  /// The one whose middle is nearest along the path.
  [[nodiscard]] std::size_t around(std::size_t keyframe) const { return around_[keyframe]; }

  /// Safe from several threads.
  [[nodiscard]] Submap load(std::size_t submap) const;

  /// What was seen from a keyframe, in its lidar frame [m]. Where the sensor sees too little at
  /// once to tell a place (few points, or a narrow view), with what its neighbours along the path
  /// saw. Safe from several threads.
  [[nodiscard]] std::vector<Eigen::Vector3f> view_from(std::size_t keyframe) const;

 private:
  [[nodiscard]] std::vector<std::size_t> stretch_around(std::size_t keyframe, double way_m,
                                                        std::size_t most) const;

  const KeyframeStore& keyframes_;
  const OdometryPath& path_;
  std::vector<std::size_t> centres_;
  std::vector<std::size_t> around_;
};

/// Turns points of a keyframe upright: z along the vertical of its drive, x where the sensor heads.
[[nodiscard]] Eigen::Matrix3d R_level_lidar(const Eigen::Isometry3d& T_odom_lidar);

}  // namespace stillmap::mapping
