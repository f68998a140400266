#include "loops/submaps.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// Middles are so far apart, and reach so far to both sides along the path [m].
constexpr double kSpacingM = 5.0;
constexpr double kReachM = 15.0;
/// Of the thinned keyframes; at least so many points are a surface. With five, a view of 52,000
/// points back along the other lane of a street finds less than it should on the map: 0.86 instead
/// of all of the revisits.
constexpr int kLeastPointsOfVoxel = 3;
/// Keyframes of a submap at most: closer ones are taken in equal steps.
constexpr std::size_t kMostKeyframes = 40;
/// Thinned points that a view should have, and by which way along the path it may grow for them.
constexpr std::size_t kEnoughPoints = 6000;
constexpr double kViewReachM = 2.0;
constexpr std::size_t kMostJoined = 11;

}  // namespace

const Eigen::Isometry3d& Submap::pose_of(std::size_t keyframe) const {
  const auto at = std::find(keyframes.begin(), keyframes.end(), keyframe);
  if (at == keyframes.end()) throw std::out_of_range("keyframe is not part of the submap");
  return T_submap_lidar[static_cast<std::size_t>(at - keyframes.begin())];
}

std::size_t Submap::nearest_to(const Eigen::Vector3d& p_submap) const {
  const auto nearest = std::min_element(T_submap_lidar.begin(), T_submap_lidar.end(),
                                        [&](const auto& a, const auto& b) {
                                          return (a.translation() - p_submap).squaredNorm() <
                                                 (b.translation() - p_submap).squaredNorm();
                                        });
  return keyframes.at(static_cast<std::size_t>(nearest - T_submap_lidar.begin()));
}

Submaps::Submaps(const KeyframeStore& keyframes, const OdometryPath& path)
    : keyframes_(keyframes), path_(path) {
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (centres_.empty() || path.way_m(centres_.back(), i) >= kSpacingM) centres_.push_back(i);
  }
  std::size_t at = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    while (at + 1 < centres_.size() &&
           path.way_m(centres_[at + 1], i) < path.way_m(centres_[at], i))
      ++at;
    // The first of a drive is a middle.
    while (path.drive(centres_[at]) != path.drive(i)) ++at;
    around_.push_back(at);
  }
}

std::vector<std::size_t> Submaps::stretch_around(std::size_t keyframe, double way_m,
                                                 std::size_t most) const {
  std::size_t begin = keyframe;
  std::size_t end = keyframe + 1;
  while (begin > 0 && path_.way_m(begin - 1, keyframe) <= way_m) --begin;
  while (end < path_.size() && path_.way_m(end, keyframe) <= way_m) ++end;
  const std::size_t step = (end - begin + most - 1) / most;
  // Steps count from the keyframe itself, so that it is always among them.
  std::vector<std::size_t> out;
  for (std::size_t i = keyframe - (keyframe - begin) / step * step; i < end; i += step)
    out.push_back(i);
  return out;
}

Submap Submaps::load(std::size_t submap) const {
  const std::size_t centre = centres_.at(submap);
  Submap out;
  out.keyframes = stretch_around(centre, kReachM, path_.size());
  for (const std::size_t keyframe : out.keyframes) {
    out.T_submap_lidar.push_back(path_.T_odom_lidar(keyframe));
    out.T_submap_lidar.back().translation() -= path_.T_odom_lidar(centre).translation();
  }
  std::vector<Eigen::Vector3d> points;
  for (const std::size_t keyframe : stretch_around(centre, kReachM, kMostKeyframes)) {
    const Eigen::Isometry3d& T_submap_lidar = out.pose_of(keyframe);
    for (const Eigen::Vector3f& p : keyframes_.read(keyframe))
      points.emplace_back(T_submap_lidar * p.cast<double>());
  }
  try {
    out.aligner = localization::make_aligner(
        "default", localization::MapIndex::build(points, {.min_points = kLeastPointsOfVoxel}),
        out.T_submap_lidar);
  } catch (const maps::InputError&) {
    // Nothing dense enough to match with: no loop leads here.
  }
  return out;
}

std::vector<Eigen::Vector3f> Submaps::view_from(std::size_t keyframe) const {
  std::vector<Eigen::Vector3f> view = keyframes_.read(keyframe);
  if (view.size() >= kEnoughPoints) return view;
  const Eigen::Isometry3d T_lidar_odom = path_.T_odom_lidar(keyframe).inverse();
  for (const std::size_t other : stretch_around(keyframe, kViewReachM, kMostJoined)) {
    if (other == keyframe) continue;
    const Eigen::Isometry3f T = (T_lidar_odom * path_.T_odom_lidar(other)).cast<float>();
    for (const Eigen::Vector3f& p : keyframes_.read(other)) view.push_back(T * p);
  }
  return view;
}

Eigen::Matrix3d R_level_lidar(const Eigen::Isometry3d& T_odom_lidar) {
  const Eigen::Matrix3d& R = T_odom_lidar.linear();
  const double heading_rad = std::atan2(R(1, 0), R(0, 0));
  return Eigen::AngleAxisd(-heading_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix() * R;
}

}  // namespace stillmap::mapping
