#pragma once

#include "views/posed_views.hpp"

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/scan.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <Eigen/Geometry>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// A scan as the stages after reading see it: only points between the two ranges, deskewed where
/// the drive tells how.
/// @param counts  `dropped_too_near` and `dropped_too_far` are added to.
[[nodiscard]] maps::Scan read_deskewed(const maps::Drive& drive, std::size_t index,
                                       const std::array<double, 2>& range_m,
                                       std::map<std::string, std::uint64_t>& counts);

/// What odometry says of a scan beside its pose, see `OdometryPose`.
enum class ScanNote : std::uint8_t { kNone, kHidden, kBeginsAnew };

/// The selected scans of all drives of a build, numbered through in order.
class DriveSet {
 public:
  struct Place {
    std::size_t drive = 0;
    /// Within the drive.
    std::size_t index = 0;
  };

  /// @param drives  with poses in one frame.
  /// @param doubts, notes  one a scan of each drive, or none.
  /// @throws maps::InputError for no selected scan, or a pose beyond 1e7 m from the first.
  DriveSet(std::vector<maps::Drive> drives, const MapBuildOptions& options,
           std::vector<std::vector<maps::PoseDisagreement>> doubts = {},
           std::vector<std::vector<ScanNote>> notes = {});

  [[nodiscard]] std::size_t size() const { return places_.size(); }
  [[nodiscard]] const std::vector<maps::Drive>& drives() const { return drives_; }
  [[nodiscard]] Place place(std::size_t scan) const { return places_.at(scan); }
  /// Pose of the frame that `read` gives a scan in: the lidar's, or, where that stands more than 12
  /// degrees off the map's vertical (tilted, upside down, carried by hand), the lidar's frame
  /// turned upright, since ground, detectors and ground heights expect z up.
  [[nodiscard]] Eigen::Isometry3d T_map_scan(std::size_t scan) const;
  /// The least rotation that turns a scan upright; the identity for a lidar within 12 degrees.
  [[nodiscard]] Eigen::Quaterniond R_scan_lidar(std::size_t scan) const;
  [[nodiscard]] maps::PoseDisagreement doubt(std::size_t scan) const;
  [[nodiscard]] ScanNote note(std::size_t scan) const;
  [[nodiscard]] std::int64_t stamp_ns(std::size_t scan) const;
  /// As `maps::Drive::Contents::scan_name` and `maps::Drive::sha256`.
  [[nodiscard]] std::string name(std::size_t scan) const;
  [[nodiscard]] std::string sha256(std::size_t scan) const;
  /// As `read_deskewed`, in the frame of `T_map_scan`. A hidden scan comes without its points.
  /// @param counts  with hidden scans, `dropped_hidden` is added to.
  [[nodiscard]] maps::Scan read(std::size_t scan,
                                std::map<std::string, std::uint64_t>& counts) const;
  /// One a drive, of the lidar itself.
  [[nodiscard]] std::vector<maps::Trajectory> trajectories() const;

 private:
  [[nodiscard]] const Eigen::Isometry3d& T_map_lidar(std::size_t scan) const;
  void check_poses() const;

  std::vector<maps::Drive> drives_;
  std::vector<std::vector<maps::PoseDisagreement>> doubts_;
  std::vector<std::vector<ScanNote>> notes_;
  std::vector<Place> places_;
  std::array<double, 2> range_m_;
};

}  // namespace stillmap::mapping
