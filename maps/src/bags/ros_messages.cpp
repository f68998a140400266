#include "bags/ros_messages.hpp"

#include <stillmap/maps/geodesy.hpp>

#include <cmath>

#include "core/pose_bounds.hpp"

namespace stillmap::maps {
namespace {

constexpr std::int64_t kRosSecondNs = 1'000'000'000;

std::string frame(std::string name) {
  if (name.starts_with('/')) name.erase(0, 1);
  return name;
}

/// Translation x y z, then the quaternion x y z w: geometry_msgs/Pose and Transform alike.
std::optional<Eigen::Isometry3d> read_rigid(MessageReader& reader) {
  const auto next = [&] { return reader.number<double>(); };
  Eigen::Vector3d t;
  Eigen::Vector4d xyzw;
  for (double& value : t) value = next();
  for (double& value : xyzw) value = next();
  const Eigen::Quaterniond q(xyzw);
  if (!(t.norm() <= kMaxPositionM) || !(std::abs(q.norm() - 1.0) <= kMaxOffRotation))
    return std::nullopt;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = q.normalized().toRotationMatrix();
  T.translation() = t;
  return T;
}

}  // namespace

std::int64_t read_time(MessageReader& reader) {
  const std::int64_t seconds = reader.is_ros1() ? std::int64_t{reader.number<std::uint32_t>()}
                                                : std::int64_t{reader.number<std::int32_t>()};
  return seconds * kRosSecondNs + reader.number<std::uint32_t>();
}

RosHeader read_header(MessageReader& reader) {
  if (reader.is_ros1()) (void)reader.number<std::uint32_t>();  // seq
  RosHeader header;
  header.stamp_ns = read_time(reader);
  header.frame_id = frame(reader.text());
  return header;
}

StampedTransform read_pose_frames(MessageReader& reader, std::string_view type) {
  const RosHeader header = read_header(reader);
  StampedTransform pose{header.stamp_ns, header.frame_id, {}, {}};
  if (type == kNavOdometry) {
    pose.child = frame(reader.text());
  } else if (type != kPoseStamped) {
    throw InputError(reader.name(), std::string(type),
                     std::string(kNavOdometry) + " or " + std::string(kPoseStamped));
  }
  return pose;
}

StampedTransform read_pose(MessageReader& reader, std::string_view type) {
  StampedTransform pose = read_pose_frames(reader, type);
  pose.T_parent_child = read_rigid(reader);
  return pose;
}

void read_transforms(MessageReader& reader,
                     const std::function<void(const StampedTransform&)>& take) {
  constexpr std::size_t kLeastBytes = 8 + 4 + 4 + 56;
  const std::size_t count = reader.count(kLeastBytes);
  for (std::size_t i = 0; i < count; ++i) {
    const RosHeader header = read_header(reader);
    StampedTransform transform{header.stamp_ns, header.frame_id, frame(reader.text()), {}};
    transform.T_parent_child = read_rigid(reader);
    take(transform);
  }
}

GnssFix read_fix(MessageReader& reader) {
  const RosHeader header = read_header(reader);
  GnssFix fix{header.stamp_ns, header.frame_id, {}};
  const bool has_fix = reader.number<std::int8_t>() >= 0;
  (void)reader.number<std::uint16_t>();  // which satellites
  GeodeticOrigin place;
  for (double* const value : {&place.latitude_deg, &place.longitude_deg, &place.altitude_m})
    *value = reader.number<double>();
  if (has_fix && violations(place).empty()) fix.place = place;
  return fix;
}

FramedImuReading read_imu(MessageReader& reader) {
  const RosHeader header = read_header(reader);
  const auto skip = [&](int numbers) {
    for (int i = 0; i < numbers; ++i) (void)reader.number<double>();
  };
  const auto vector = [&] {
    Eigen::Vector3f v;
    for (float& value : v) value = static_cast<float>(reader.number<double>());
    return v;
  };
  constexpr int kOrientation = 4;
  constexpr int kCovariance = 9;
  skip(kOrientation + kCovariance);
  FramedImuReading imu{{header.stamp_ns, vector(), {}}, header.frame_id};
  skip(kCovariance);
  imu.reading.force_mps2 = vector();
  return imu;
}

}  // namespace stillmap::maps
