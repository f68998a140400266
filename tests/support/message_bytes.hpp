#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

/// ROS messages, written out by hand so that tests do not depend on a writer of ours.
namespace stillmap::test {

/// Values of one message, one after the other.
class MessageBytes {
 public:
  enum class Kind { kLittleEndian, kBigEndian, kRos1 };
  explicit MessageBytes(Kind kind = Kind::kLittleEndian) : kind_(kind) {
    if (kind == Kind::kLittleEndian) bytes_.assign("\0\1\0\0", 4);
    if (kind == Kind::kBigEndian) bytes_.assign("\0\0\0\0", 4);
  }

  template <typename Number>
  MessageBytes& put(Number number) {
    while (kind_ != Kind::kRos1 && (bytes_.size() - 4) % sizeof(Number) != 0) bytes_ += '\0';
    char raw[sizeof(Number)];
    std::memcpy(raw, &number, sizeof(Number));
    if (kind_ == Kind::kBigEndian) std::reverse(raw, raw + sizeof(Number));
    bytes_.append(raw, sizeof(Number));
    return *this;
  }
  MessageBytes& text(std::string_view letters) {
    const bool nul = kind_ != Kind::kRos1;
    put(static_cast<std::uint32_t>(letters.size() + (nul ? 1 : 0)));
    bytes_ += letters;
    if (nul) bytes_ += '\0';
    return *this;
  }
  MessageBytes& bytes(std::string_view content) {
    put(static_cast<std::uint32_t>(content.size()));
    bytes_ += content;
    return *this;
  }
  MessageBytes& header(std::int64_t stamp_ns, std::string_view frame) {
    if (kind_ == Kind::kRos1) put(std::uint32_t{0});
    put(static_cast<std::int32_t>(stamp_ns / 1'000'000'000));
    put(static_cast<std::uint32_t>(stamp_ns % 1'000'000'000));
    return text(frame);
  }
  [[nodiscard]] const std::string& str() const { return bytes_; }

 private:
  Kind kind_;
  std::string bytes_;
};

/// sensor_msgs/PointCloud2. Datatypes: 1 INT8, 2 UINT8, 3 INT16, 4 UINT16, 5 INT32, 6 UINT32, 7
/// FLOAT32, 8 FLOAT64.
struct CloudMessage {
  struct Field {
    std::string name;
    std::uint32_t offset = 0;
    std::uint8_t type = 7;
    std::uint32_t count = 1;
  };
  std::int64_t stamp_ns = 5'000'000'000;
  std::string frame = "lidar";
  std::uint32_t height = 1;
  std::uint32_t width = 1;
  std::vector<Field> fields{{"x", 0}, {"y", 4}, {"z", 8}};
  bool big_endian = false;
  std::uint32_t point_step = 12;
  std::uint32_t row_step = 12;
  std::string data;

  [[nodiscard]] std::string str(MessageBytes::Kind kind = MessageBytes::Kind::kLittleEndian) const {
    MessageBytes message(kind);
    message.header(stamp_ns, frame).put(height).put(width);
    message.put(static_cast<std::uint32_t>(fields.size()));
    for (const Field& field : fields)
      message.text(field.name).put(field.offset).put(field.type).put(field.count);
    message.put(static_cast<std::uint8_t>(big_endian)).put(point_step).put(row_step);
    return message.bytes(data).put(std::uint8_t{1}).str();
  }
};

/// A cloud of one point (x, 0, 0).
[[nodiscard]] inline std::string one_point(std::int64_t stamp_ns, float x,
                                           const std::string& frame = "lidar") {
  CloudMessage cloud;
  cloud.stamp_ns = stamp_ns;
  cloud.frame = frame;
  cloud.data.assign(12, '\0');
  std::memcpy(cloud.data.data(), &x, sizeof(x));
  return cloud.str();
}

struct PoseValues {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
  double qx = 0.0;
  double qy = 0.0;
  double qz = 0.0;
  double qw = 1.0;
};

inline void put_pose(MessageBytes& message, const PoseValues& pose) {
  for (const double value : {pose.x, pose.y, pose.z, pose.qx, pose.qy, pose.qz, pose.qw})
    message.put(value);
}

/// nav_msgs/Odometry.
[[nodiscard]] inline std::string odometry(std::int64_t stamp_ns, const PoseValues& pose,
                                          std::string_view child = "base_link",
                                          std::string_view parent = "odom") {
  MessageBytes message;
  message.header(stamp_ns, parent).text(child);
  put_pose(message, pose);
  for (int i = 0; i < 36 + 6 + 36; ++i) message.put(0.0);
  return message.str();
}

/// geometry_msgs/PoseStamped.
[[nodiscard]] inline std::string pose_stamped(std::int64_t stamp_ns, const PoseValues& pose,
                                              std::string_view parent = "map") {
  MessageBytes message;
  message.header(stamp_ns, parent);
  put_pose(message, pose);
  return message.str();
}

/// sensor_msgs/NavSatFix. @param status  below 0 without a fix.
[[nodiscard]] inline std::string nav_sat_fix(
    std::int64_t stamp_ns, double latitude_deg, double longitude_deg, double altitude_m,
    std::string_view frame = "gps", std::int8_t status = 0,
    MessageBytes::Kind kind = MessageBytes::Kind::kLittleEndian) {
  MessageBytes message(kind);
  message.header(stamp_ns, frame).put(status).put(std::uint16_t{1});
  message.put(latitude_deg).put(longitude_deg).put(altitude_m);
  for (int i = 0; i < 9; ++i) message.put(0.0);
  return message.put(std::uint8_t{0}).str();
}

/// tf2_msgs/TFMessage of one transform.
[[nodiscard]] inline std::string transform(std::int64_t stamp_ns, std::string_view parent,
                                           std::string_view child, const PoseValues& pose) {
  MessageBytes message;
  message.put(std::uint32_t{1}).header(stamp_ns, parent).text(child);
  put_pose(message, pose);
  return message.str();
}

}  // namespace stillmap::test
