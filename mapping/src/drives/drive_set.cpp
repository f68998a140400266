#include "drives/drive_set.hpp"

#include <stillmap/mapping/deskew.hpp>

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <utility>

namespace stillmap::mapping {
namespace {

/// No drive on Earth gets farther from its start [m]; cells around it are counted with 32 bits.
constexpr double kFarthestM = 1e7;
/// Ground is found, and networks were trained, within this of upright (12 degrees).
constexpr double kUprightCosine = 0.9781;

void keep_range(maps::PointCloud& cloud, const std::array<double, 2>& range_m,
                std::map<std::string, std::uint64_t>& counts) {
  const auto near2 = static_cast<float>(range_m[0] * range_m[0]);
  const auto far2 = static_cast<float>(range_m[1] * range_m[1]);
  std::uint64_t too_near = 0, too_far = 0;
  std::vector<std::uint8_t> keep(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float range2 = cloud.ray(i).squaredNorm();
    too_near += range2 < near2 ? 1 : 0;
    too_far += range2 > far2 ? 1 : 0;
    keep[i] = range2 >= near2 && range2 <= far2 ? 1 : 0;
  }
  cloud.keep_only(keep);
  counts["dropped_too_near"] += too_near;
  counts["dropped_too_far"] += too_far;
}

}  // namespace

maps::Scan read_deskewed(const maps::Drive& drive, std::size_t index,
                         const std::array<double, 2>& range_m,
                         std::map<std::string, std::uint64_t>& counts) {
  maps::Scan scan = drive.read(index);
  keep_range(scan.cloud, range_m, counts);
  if (const auto twist = twist_at(drive, index)) deskew(scan.cloud, *twist);
  return scan;
}

DriveSet::DriveSet(std::vector<maps::Drive> drives, const MapBuildOptions& options,
                   std::vector<std::vector<maps::PoseDisagreement>> doubts,
                   std::vector<std::vector<ScanNote>> notes)
    : drives_(std::move(drives)),
      doubts_(std::move(doubts)),
      notes_(std::move(notes)),
      range_m_{options.min_range_m, options.max_range_m} {
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    const std::vector<std::size_t> indices = options.scans_of(drives_[i].size());
    if (indices.empty())
      throw maps::InputError(drives_[i].contents().root.string(),
                             fmt::format("{} scans, none selected", drives_[i].size()),
                             "at least one: change --select");
    for (const std::size_t index : indices) places_.push_back({i, index});
  }
  check_poses();
}

void DriveSet::check_poses() const {
  const Eigen::Vector3d start = T_map_lidar(0).translation();
  for (std::size_t scan = 0; scan < size(); ++scan) {
    const Eigen::Vector3d way = T_map_lidar(scan).translation() - start;
    // Written so that a NaN fails.
    if ((way.array().abs() <= kFarthestM).all()) continue;
    throw maps::InputError(
        name(scan), fmt::format("a pose {:g} m from the first scan's", way.norm()),
        fmt::format("within {:g} m: check the poses, or leave this scan out with --select",
                    kFarthestM));
  }
}

const Eigen::Isometry3d& DriveSet::T_map_lidar(std::size_t scan) const {
  const Place at = place(scan);
  return drives_[at.drive].T_map_lidar(at.index);
}

maps::PoseDisagreement DriveSet::doubt(std::size_t scan) const {
  return doubts_.empty() ? maps::PoseDisagreement{}
                         : doubts_.at(places_[scan].drive).at(places_[scan].index);
}

ScanNote DriveSet::note(std::size_t scan) const {
  return notes_.empty() ? ScanNote::kNone : notes_.at(places_[scan].drive).at(places_[scan].index);
}

std::int64_t DriveSet::stamp_ns(std::size_t scan) const {
  const Place at = place(scan);
  return drives_[at.drive].stamp_ns(at.index);
}

std::string DriveSet::name(std::size_t scan) const {
  const Place at = place(scan);
  return drives_[at.drive].contents().scan_name(at.index);
}

std::string DriveSet::sha256(std::size_t scan) const {
  const Place at = place(scan);
  return drives_[at.drive].sha256(at.index);
}

Eigen::Quaterniond DriveSet::R_scan_lidar(std::size_t scan) const {
  const Eigen::Vector3d up_lidar = T_map_lidar(scan).linear().row(2);
  if (up_lidar.z() >= kUprightCosine) return Eigen::Quaterniond::Identity();
  return maps::turn_between(up_lidar, Eigen::Vector3d::UnitZ());
}

Eigen::Isometry3d DriveSet::T_map_scan(std::size_t scan) const {
  Eigen::Isometry3d T = T_map_lidar(scan);
  const Eigen::Quaterniond R = R_scan_lidar(scan);
  if (R.w() == 1.0) return T;
  T.linear() *= R.conjugate().toRotationMatrix();
  return T;
}

maps::Scan DriveSet::read(std::size_t number, std::map<std::string, std::uint64_t>& counts) const {
  const Place at = place(number);
  if (note(number) == ScanNote::kHidden) {
    maps::Scan hidden = drives_[at.drive].read(at.index);
    counts["dropped_hidden"] += hidden.cloud.size();
    hidden.cloud = {};
    return hidden;
  }
  maps::Scan scan = read_deskewed(drives_[at.drive], at.index, range_m_, counts);
  const Eigen::Quaterniond R = R_scan_lidar(number);
  if (R.w() == 1.0) return scan;
  const Eigen::Matrix3f turn = R.toRotationMatrix().cast<float>();
  for (Eigen::Vector3f& p : scan.cloud.positions) p = turn * p;
  for (Eigen::Vector3f& origin : scan.cloud.lidar_origins) origin = turn * origin;
  return scan;
}

std::vector<maps::Trajectory> DriveSet::trajectories() const {
  std::vector<std::vector<maps::StampedPose>> poses(drives_.size());
  for (const Place& at : places_)
    poses[at.drive].push_back(
        {drives_[at.drive].stamp_ns(at.index), drives_[at.drive].T_map_lidar(at.index)});
  std::vector<maps::Trajectory> trajectories;
  for (std::vector<maps::StampedPose>& each : poses) trajectories.emplace_back(std::move(each));
  return trajectories;
}

}  // namespace stillmap::mapping
