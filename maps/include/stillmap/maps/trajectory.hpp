#pragma once

#include <Eigen/Geometry>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

namespace stillmap::maps {

/// Time from `from_ns` to `to_ns` [s], negative backwards: exact to the nanosecond for neighbours,
/// without overflow however far apart.
[[nodiscard]] double seconds_between(std::int64_t from_ns, std::int64_t to_ns);

/// One pose of a path.
struct StampedPose {
  std::int64_t stamp_ns = 0;
  Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
};

/// A path with strictly increasing stamps.
class Trajectory {
 public:
  Trajectory() = default;
  /// @throws std::invalid_argument if stamps do not strictly increase or a pose is not finite.
  explicit Trajectory(std::vector<StampedPose> poses);

  [[nodiscard]] const std::vector<StampedPose>& poses() const { return poses_; }
  [[nodiscard]] std::size_t size() const { return poses_.size(); }
  [[nodiscard]] bool empty() const { return poses_.empty(); }

  /// Pose at a time: linear in translation, spherical linear in rotation, between the two
  /// neighbours. Up to `max_extrapolation_s` [s, >= 0] beyond either end the last two poses are
  /// continued at constant velocity. @return nothing when farther out, or with fewer than two poses
  /// and no exact hit.
  [[nodiscard]] std::optional<Eigen::Isometry3d> at(std::int64_t stamp_ns,
                                                    double max_extrapolation_s = 0.2) const;

 private:
  std::vector<StampedPose> poses_;
};

/// Poses of a file without stamps: 12 numbers a line, 3x4 row-major (KITTI), as `read_pose_file`
/// reads them; none of an empty file. @throws InputError naming file, line and value, also for
/// other formats.
[[nodiscard]] std::vector<Eigen::Isometry3d> read_kitti_poses(const std::filesystem::path& file);

/// TUM: `stamp tx ty tz qx qy qz qw` a line, as `read_pose_file` reads it.
/// @return an empty path for an empty file.
/// @throws InputError naming file, line and value, also for other formats.
[[nodiscard]] Trajectory read_tum_trajectory(const std::filesystem::path& file);

/// Writes TUM with 9 decimals of stamp, 17 significant digits elsewhere. @throws StorageError.
void write_tum_trajectory(const std::filesystem::path& file, const Trajectory& trajectory);

}  // namespace stillmap::maps
