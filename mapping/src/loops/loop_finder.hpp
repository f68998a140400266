#pragma once

#include <stillmap/mapping/progress.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// A scan that loops may lead to.
struct LoopKeyframe {
  /// Deskewed [m], lidar frame; thinned or not.
  std::vector<Eigen::Vector3f> points;
  /// As odometry has it; keyframes of one drive follow each other.
  Eigen::Isometry3d T_odom_lidar = Eigen::Isometry3d::Identity();
  /// Of the motion since the keyframe before (order as in `OdometryPose`).
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  /// Drives have odometry frames of their own.
  std::uint32_t drive = 0;
};

/// Two keyframes that saw the same place.
struct Loop {
  std::size_t from = 0;
  /// The later one.
  std::size_t to = 0;
  Eigen::Isometry3d T_from_to = Eigen::Isometry3d::Identity();
  /// Perturbation on the right, order as in `OdometryPose`.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
  double inlier_ratio = 0.0;
  double rmse_m = 0.0;
};

/// Where all keyframes were taken, as something else tells, in one frame for all drives.
struct GivenPlaces {
  /// One a keyframe.
  std::span<const Eigen::Isometry3d> T_map_lidar;
  /// Of each in every direction [m, rad].
  double sigma_m = 0.0;
  double sigma_rad = 0.0;
};

/// Finds loops among keyframes, in the order in which they come.
///
/// Candidates: places whose Scan Context looks alike (Kim and Kim, IROS 2018), and places that
/// odometry, with its growing covariance, may have come back to. Each is verified by alignment with
/// the map of the keyframes around the candidate, and is a loop only when that answer is sure.
class LoopFinder {
 public:
  /// @param scratch  existing folder for the keyframes' points, so that memory holds descriptors
  /// alone.
  explicit LoopFinder(const std::filesystem::path& scratch);
  ~LoopFinder();
  LoopFinder(const LoopFinder&) = delete;
  LoopFinder& operator=(const LoopFinder&) = delete;

  void add(const LoopKeyframe& keyframe);
  /// All loops between the keyframes added so far; the same for any number of threads.
  /// @param given  of these keyframes: loops are looked for where they say.
  [[nodiscard]] std::vector<Loop> find(int threads, const ProgressCallback& progress,
                                       const CancelFlag& cancel,
                                       const std::optional<GivenPlaces>& given = {});

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace stillmap::mapping
