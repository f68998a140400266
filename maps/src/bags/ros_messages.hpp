#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/imu.hpp>

#include <Eigen/Geometry>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "bags/message_reader.hpp"

namespace stillmap::maps {

inline constexpr std::string_view kPointCloud2 = "sensor_msgs/msg/PointCloud2";
inline constexpr std::string_view kNavOdometry = "nav_msgs/msg/Odometry";
inline constexpr std::string_view kPoseStamped = "geometry_msgs/msg/PoseStamped";
inline constexpr std::string_view kTfMessage = "tf2_msgs/msg/TFMessage";
inline constexpr std::string_view kNavSatFix = "sensor_msgs/msg/NavSatFix";
inline constexpr std::string_view kImu = "sensor_msgs/msg/Imu";

/// std_msgs/Header.
struct RosHeader {
  std::int64_t stamp_ns = 0;
  /// Without the slash that ROS 1 put before it.
  std::string frame_id;
};
/// Seconds and nanoseconds -> [ns]. ROS 1 counts seconds without a sign.
[[nodiscard]] std::int64_t read_time(MessageReader& reader);
[[nodiscard]] RosHeader read_header(MessageReader& reader);

/// A transform of one instant between two frames.
struct StampedTransform {
  std::int64_t stamp_ns = 0;
  std::string parent;
  /// Empty where the message names none (PoseStamped).
  std::string child;
  /// Nothing when a number is not finite or the quaternion is off norm 1 by over 1e-3, as of an
  /// estimator that has not started yet.
  std::optional<Eigen::Isometry3d> T_parent_child;
};

/// nav_msgs/Odometry or geometry_msgs/PoseStamped.
/// @throws InputError for a message that ends too early or is of another type.
[[nodiscard]] StampedTransform read_pose(MessageReader& reader, std::string_view type);

/// The beginning of such a message: all but its transform.
[[nodiscard]] StampedTransform read_pose_frames(MessageReader& reader, std::string_view type);

/// tf2_msgs/TFMessage: `take` for each transform.
/// @throws InputError as above; what was before the break has been taken.
void read_transforms(MessageReader& reader,
                     const std::function<void(const StampedTransform&)>& take);

/// Where an antenna was.
struct GnssFix {
  std::int64_t stamp_ns = 0;
  /// Of the antenna; empty where nothing names it.
  std::string frame_id;
  /// Nothing where the receiver had no fix, or the place is none on Earth: no altitude is one.
  std::optional<GeodeticOrigin> place;
};

/// sensor_msgs/NavSatFix up to its covariance. @throws InputError as above.
[[nodiscard]] GnssFix read_fix(MessageReader& reader);

/// What an IMU measured, in its own axes, and their frame.
struct FramedImuReading {
  ImuReading reading;
  std::string frame_id;
};

/// sensor_msgs/Imu up to its specific force. Its orientation and all covariances are not looked at.
/// @throws InputError as above.
[[nodiscard]] FramedImuReading read_imu(MessageReader& reader);

}  // namespace stillmap::maps
