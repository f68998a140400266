#pragma once

#include <Eigen/Geometry>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "output/drive_writer.hpp"
#include "sensing/simulated_scan.hpp"

namespace stillmap::simulation {

/// What one layout has of its own. Labels, boxes and truth, which lie alike in all of them, are
/// written by DriveWriter.
class LayoutWriter {
 public:
  virtual ~LayoutWriter() = default;

  /// What `maps::Drive::open` takes.
  [[nodiscard]] virtual std::filesystem::path drive_folder() const = 0;
  /// Name of a scan's files without what follows the dot.
  [[nodiscard]] virtual std::string stem_of(std::size_t index) const = 0;
  /// Whether the layout's scans have been freed from the motion of their sweep.
  [[nodiscard]] virtual bool at_stamp() const = 0;
  /// @param positions  of `scan.points`, moved to the stamp where `at_stamp`.
  virtual void add(std::size_t index, const SimulatedScan& scan,
                   const std::vector<Eigen::Vector3f>& positions) = 0;
  virtual void finish() = 0;

  /// The layout's clock.
  [[nodiscard]] virtual std::int64_t stamp_ns(double time_s) const;
  /// The frame of the layout's poses. Known after the first scan.
  [[nodiscard]] virtual Eigen::Isometry3d T_map_world() const = 0;
};

/// KITTI odometry and SemanticKITTI: `velodyne/`, `calib.txt`, `poses.txt`, `times.txt`. The map
/// frame is `options.T_world_map`.
[[nodiscard]] std::unique_ptr<LayoutWriter> make_kitti_odometry_writer(
    const std::filesystem::path& folder, const DriveWriterOptions& options,
    const TruePath& T_world_lidar);

/// KITTI raw, synced: the folder is that of the date, with calibrations and
/// `DATE_drive_0001_sync/`; poses only as `oxts/` with its errors. The map frame lies where the
/// first oxts packet says.
[[nodiscard]] std::unique_ptr<LayoutWriter> make_kitti_raw_writer(
    const std::filesystem::path& folder, const DriveWriterOptions& options,
    const TruePath& T_world_lidar);

/// `scans/*.pcd` with a time for each point, `trajectory.txt` (TUM); the same poses as
/// `optimized_poses.txt` with `times.txt`, which make it a folder of key frames that is opened as
/// it is. The map frame is the world's.
[[nodiscard]] std::unique_ptr<LayoutWriter> make_pcd_writer(const std::filesystem::path& folder,
                                                            const TruePath& T_world_lidar);

}  // namespace stillmap::simulation
