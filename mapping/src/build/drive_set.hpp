#pragma once

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

/// The selected scans of all drives of a build, numbered through in order.
class DriveSet {
 public:
  struct Place {
    std::size_t drive = 0;
    /// Within the drive.
    std::size_t index = 0;
  };

  /// @param drives  with poses in one frame.
  /// @throws maps::InputError for no selected scan, or a pose beyond 1e7 m from the first.
  DriveSet(std::vector<maps::Drive> drives, const MapBuildOptions& options);

  [[nodiscard]] std::size_t size() const { return places_.size(); }
  [[nodiscard]] const std::vector<maps::Drive>& drives() const { return drives_; }
  [[nodiscard]] Place place(std::size_t scan) const { return places_.at(scan); }
  [[nodiscard]] const Eigen::Isometry3d& T_map_lidar(std::size_t scan) const;
  [[nodiscard]] std::int64_t stamp_ns(std::size_t scan) const;
  /// As `maps::Drive::Contents::scan_name` and `maps::Drive::sha256`.
  [[nodiscard]] std::string name(std::size_t scan) const;
  [[nodiscard]] std::string sha256(std::size_t scan) const;
  /// As `read_deskewed`.
  [[nodiscard]] maps::Scan read(std::size_t scan,
                                std::map<std::string, std::uint64_t>& counts) const;
  /// One a drive.
  [[nodiscard]] std::vector<maps::Trajectory> trajectories() const;

 private:
  void check_poses() const;

  std::vector<maps::Drive> drives_;
  std::vector<Place> places_;
  std::array<double, 2> range_m_;
};

}  // namespace stillmap::mapping
