#pragma once

// As much of ROS 2 (Humble) as the node of ROS 2 uses, by the signatures in its documentation, so
// that a change of the shared code that breaks the node is seen where there is no ROS 2. Nothing
// here works.

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace builtin_interfaces::msg {
struct Time {
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;
};
}  // namespace builtin_interfaces::msg

namespace std_msgs::msg {
struct Header {
  builtin_interfaces::msg::Time stamp;
  std::string frame_id;
};
}  // namespace std_msgs::msg

namespace geometry_msgs::msg {
struct Point {
  double x = 0.0, y = 0.0, z = 0.0;
};
struct Vector3 {
  double x = 0.0, y = 0.0, z = 0.0;
};
struct Quaternion {
  double x = 0.0, y = 0.0, z = 0.0, w = 1.0;
};
struct Pose {
  Point position;
  Quaternion orientation;
};
struct PoseWithCovariance {
  Pose pose;
  std::array<double, 36> covariance{};
};
struct PoseWithCovarianceStamped {
  using ConstSharedPtr = std::shared_ptr<const PoseWithCovarianceStamped>;
  std_msgs::msg::Header header;
  PoseWithCovariance pose;
};
struct Transform {
  Vector3 translation;
  Quaternion rotation;
};
struct TransformStamped {
  std_msgs::msg::Header header;
  std::string child_frame_id;
  Transform transform;
};
}  // namespace geometry_msgs::msg

namespace nav_msgs::msg {
struct Odometry {
  using ConstSharedPtr = std::shared_ptr<const Odometry>;
  std_msgs::msg::Header header;
  std::string child_frame_id;
  geometry_msgs::msg::PoseWithCovariance pose;
};
}  // namespace nav_msgs::msg

namespace sensor_msgs::msg {
struct PointField {
  std::string name;
  std::uint32_t offset = 0;
  std::uint8_t datatype = 0;
  std::uint32_t count = 0;
};
struct PointCloud2 {
  std_msgs::msg::Header header;
  std::uint32_t height = 0, width = 0;
  std::vector<PointField> fields;
  bool is_bigendian = false;
  std::uint32_t point_step = 0, row_step = 0;
  std::vector<std::uint8_t> data;
  bool is_dense = false;
};
}  // namespace sensor_msgs::msg

namespace diagnostic_msgs::msg {
struct KeyValue {
  std::string key, value;
};
struct DiagnosticStatus {
  std::uint8_t level = 0;
  std::string name, message, hardware_id;
  std::vector<KeyValue> values;
};
struct DiagnosticArray {
  std_msgs::msg::Header header;
  std::vector<DiagnosticStatus> status;
};
}  // namespace diagnostic_msgs::msg

struct rcl_serialized_message_t {
  std::uint8_t* buffer;
  std::size_t buffer_length;
};

namespace rclcpp {
class Time {
 public:
  explicit Time(std::int64_t nanoseconds = 0);
  Time(const builtin_interfaces::msg::Time& time);
  operator builtin_interfaces::msg::Time() const;
  std::int64_t nanoseconds() const;
};
class Clock {};
class Logger {};
Logger get_logger(const std::string& name);
class SerializedMessage {
 public:
  const rcl_serialized_message_t& get_rcl_serialized_message() const;
};
class QoS {
 public:
  QoS(std::size_t history_depth);
  QoS& keep_last(std::size_t depth);
  QoS& transient_local();
};
class SensorDataQoS : public QoS {
 public:
  SensorDataQoS();
};
enum class CallbackGroupType { MutuallyExclusive, Reentrant };
class CallbackGroup {
 public:
  using SharedPtr = std::shared_ptr<CallbackGroup>;
};
struct SubscriptionOptions {
  CallbackGroup::SharedPtr callback_group;
};
template <typename Message>
class Publisher {
 public:
  using SharedPtr = std::shared_ptr<Publisher>;
  void publish(const Message& message);
};
template <typename Message>
class Subscription {
 public:
  using SharedPtr = std::shared_ptr<Subscription>;
};
class GenericSubscription {
 public:
  using SharedPtr = std::shared_ptr<GenericSubscription>;
  const char* get_topic_name() const;
};
class TimerBase {
 public:
  using SharedPtr = std::shared_ptr<TimerBase>;
};
class Node {
 public:
  explicit Node(const std::string& name);
  template <typename Value>
  Value declare_parameter(const std::string& name, const Value& value);
  template <typename Message>
  typename Publisher<Message>::SharedPtr create_publisher(const std::string& topic, const QoS& qos);
  template <typename Message>
  typename Subscription<Message>::SharedPtr create_subscription(
      const std::string& topic, const QoS& qos,
      std::function<void(const typename Message::ConstSharedPtr&)> callback);
  GenericSubscription::SharedPtr create_generic_subscription(
      const std::string& topic, const std::string& type, const QoS& qos,
      std::function<void(std::shared_ptr<SerializedMessage>)> callback,
      const SubscriptionOptions& options);
  CallbackGroup::SharedPtr create_callback_group(CallbackGroupType type);
  TimerBase::SharedPtr create_wall_timer(std::chrono::milliseconds period,
                                         std::function<void()> callback);
  std::shared_ptr<Clock> get_clock();
  Logger get_logger() const;
  Time now() const;
  const char* get_fully_qualified_name() const;
};
struct ExecutorOptions {};
namespace executors {
class MultiThreadedExecutor {
 public:
  MultiThreadedExecutor(const ExecutorOptions& options, std::size_t threads);
  void add_node(std::shared_ptr<Node> node);
  void spin();
};
}  // namespace executors
void init(int count, char** arguments);
void shutdown();
template <typename... Values>
void log(const Values&... values);
}  // namespace rclcpp

#define RCLCPP_ERROR(...) rclcpp::log(__VA_ARGS__)
#define RCLCPP_FATAL(...) rclcpp::log(__VA_ARGS__)
#define RCLCPP_WARN_ONCE(...) rclcpp::log(__VA_ARGS__)
#define RCLCPP_WARN_THROTTLE(logger, clock, period_ms, ...) \
  rclcpp::log(logger, clock, period_ms, __VA_ARGS__)

namespace tf2 {
class TransformException : public std::runtime_error {
  using std::runtime_error::runtime_error;
};
using TimePoint = std::chrono::time_point<std::chrono::system_clock, std::chrono::nanoseconds>;
constexpr TimePoint TimePointZero{};
}  // namespace tf2

namespace tf2_ros {
class Buffer {
 public:
  explicit Buffer(std::shared_ptr<rclcpp::Clock> clock);
  geometry_msgs::msg::TransformStamped lookupTransform(const std::string& target,
                                                       const std::string& source,
                                                       const tf2::TimePoint& time) const;
};
class TransformListener {
 public:
  explicit TransformListener(Buffer& buffer);
};
class TransformBroadcaster {
 public:
  explicit TransformBroadcaster(rclcpp::Node& node);
  void sendTransform(const geometry_msgs::msg::TransformStamped& transform);
};
class StaticTransformBroadcaster {
 public:
  explicit StaticTransformBroadcaster(rclcpp::Node& node);
  void sendTransform(const geometry_msgs::msg::TransformStamped& transform);
};
}  // namespace tf2_ros
