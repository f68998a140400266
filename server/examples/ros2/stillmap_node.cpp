// A node of ROS 2 that localizes a vehicle by a stillmap server: see ../README.md. It was compiled
// against stand-ins of ROS 2's headers only, and never run.

#include <tf2/exceptions.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>
#include <diagnostic_msgs/msg/diagnostic_array.hpp>
#include <geometry_msgs/msg/pose_with_covariance_stamped.hpp>
#include <nav_msgs/msg/odometry.hpp>
#include <rclcpp/rclcpp.hpp>
#include <sensor_msgs/msg/point_cloud2.hpp>

#include <cstdlib>
#include <memory>

#include "ros_messages.hpp"
#include "vehicle_localizer.hpp"

namespace {

using namespace stillmap;
using DiagnosticArray = diagnostic_msgs::msg::DiagnosticArray;
using Odometry = nav_msgs::msg::Odometry;
using PointCloud2 = sensor_msgs::msg::PointCloud2;
using PoseStamped = geometry_msgs::msg::PoseWithCovarianceStamped;

std::chrono::milliseconds milliseconds_of(double seconds) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(1000.0 * seconds));
}

class Node : public rclcpp::Node {
 public:
  Node()
      : rclcpp::Node("stillmap"),
        map_frame_(declare_parameter<std::string>("map_frame", "map")),
        base_frame_(declare_parameter<std::string>("base_frame", "base_link")),
        publishes_tf_(declare_parameter<bool>("publish_tf", true)),
        cloud_type_(declare_parameter<std::string>("cloud_type", "sensor_msgs/msg/PointCloud2")),
        settings_(settings()),
        buffer_(get_clock()),
        transforms_(buffer_),
        broadcaster_(*this),
        tiles_frame_(*this),
        poses_(create_publisher<PoseStamped>("~/pose", rclcpp::QoS(10))),
        tiles_(create_publisher<PointCloud2>("~/map_tiles", rclcpp::QoS(1).transient_local())),
        diagnostics_(create_publisher<DiagnosticArray>("/diagnostics", rclcpp::QoS(10))),
        localizer_(settings_,
                   {[this](const std::string& lidar_frame) { return find_mount(lidar_frame); },
                    [this](const vehicle::Estimate& estimate) { publish(estimate); },
                    [this](const vehicle::MapPoints& points) { publish(points); }}) {
    // Callbacks of one group run one after the other: decoding a scan must not hold odometry back.
    rclcpp::SubscriptionOptions beside;
    beside.callback_group = create_callback_group(rclcpp::CallbackGroupType::MutuallyExclusive);
    // As it came: its bytes are what the decoder reads.
    scans_ = create_generic_subscription(
        "points", cloud_type_, rclcpp::SensorDataQoS().keep_last(1),
        [this](std::shared_ptr<rclcpp::SerializedMessage> message) {
          const rcl_serialized_message_t& bytes = message->get_rcl_serialized_message();
          localizer_.take_ros2_scan(cloud_type_, bytes.buffer, bytes.buffer_length,
                                    scans_->get_topic_name());
        },
        beside);
    odometry_ = create_subscription<Odometry>(
        "odom", rclcpp::SensorDataQoS().keep_last(100),
        [this](const Odometry::ConstSharedPtr& message) { take_odometry(*message); });
    initial_poses_ = create_subscription<PoseStamped>(
        "/initialpose", rclcpp::QoS(1),
        [this](const PoseStamped::ConstSharedPtr& message) { take_initial_pose(*message); });
    timer_ = create_wall_timer(std::chrono::milliseconds(500), [this] { tell(); });
  }

 private:
  vehicle::Settings settings() {
    vehicle::Settings settings;
    const char* const key = std::getenv("STILLMAP_KEY");
    settings.url = declare_parameter<std::string>("url", settings.url);
    settings.key = declare_parameter<std::string>("key", key == nullptr ? "" : key);
    settings.map = declare_parameter<std::string>("map", settings.map);
    settings.version = declare_parameter<std::string>("version", settings.version);
    settings.label = declare_parameter<std::string>("label", get_fully_qualified_name());
    settings.thin = vehicle::thin_profile_of(declare_parameter<std::string>("thin", "exact"));
    settings.own_vehicle_m = declare_parameter<double>("own_vehicle_m", settings.own_vehicle_m);
    settings.deadline = milliseconds_of(declare_parameter<double>("deadline_s", 1.0));
    settings.patience = milliseconds_of(declare_parameter<double>("patience_s", 2.0));
    settings.odometry_sigma_m = declare_parameter<double>("odometry_sigma_m", 0.0);
    settings.odometry_sigma_rad = declare_parameter<double>("odometry_sigma_rad", 0.0);
    settings.tile_radius_m = declare_parameter<double>("tile_radius_m", 60.0);
    return settings;
  }

  std::optional<Eigen::Isometry3d> find_mount(const std::string& lidar_frame) {
    try {
      const auto mount = buffer_.lookupTransform(base_frame_, lidar_frame, tf2::TimePointZero);
      return vehicle::motion_of_transform(mount.transform);
    } catch (const tf2::TransformException& error) {
      RCLCPP_WARN_THROTTLE(get_logger(), *get_clock(), 5000, "no transform from %s to %s yet: %s",
                           base_frame_.c_str(), lidar_frame.c_str(), error.what());
      return std::nullopt;
    }
  }

  void take_odometry(const Odometry& message) {
    const auto T_odom_base = vehicle::motion_of(message.pose.pose);
    if (!T_odom_base) {
      RCLCPP_WARN_THROTTLE(get_logger(), *get_clock(), 5000,
                           "odometry without a rotation is left out");
      return;
    }
    if (!message.child_frame_id.empty() && message.child_frame_id != base_frame_)
      RCLCPP_WARN_ONCE(get_logger(), "odometry is of %s, not of %s: set base_frame",
                       message.child_frame_id.c_str(), base_frame_.c_str());
    localizer_.take_odometry(rclcpp::Time(message.header.stamp).nanoseconds(), *T_odom_base);
    const auto T_map_odom = localizer_.T_map_odom();
    if (!publishes_tf_ || !T_map_odom) return;
    geometry_msgs::msg::TransformStamped transform;
    transform.header.stamp = message.header.stamp;
    transform.header.frame_id = map_frame_;
    transform.child_frame_id = message.header.frame_id;
    vehicle::fill(transform.transform.translation, transform.transform.rotation, *T_map_odom);
    broadcaster_.sendTransform(transform);
  }

  void take_initial_pose(const PoseStamped& message) {
    const auto T_map_base = vehicle::motion_of(message.pose.pose);
    if (message.header.frame_id != map_frame_ || !T_map_base) {
      RCLCPP_ERROR(get_logger(),
                   "initial pose in frame '%s' is refused: give a rotation, and the frame '%s'",
                   message.header.frame_id.c_str(), map_frame_.c_str());
      return;
    }
    if (!localizer_.initialize(*T_map_base, vehicle::matrix_of(message.pose.covariance)))
      RCLCPP_ERROR(get_logger(),
                   "the initial pose came before the lidar's transform: give it again");
  }

  void publish(const vehicle::Estimate& estimate) {
    PoseStamped message;
    message.header.stamp = rclcpp::Time(estimate.stamp_ns);
    message.header.frame_id = map_frame_;
    vehicle::fill(message.pose, estimate);
    poses_->publish(message);
  }

  void publish(const vehicle::MapPoints& points) {
    geometry_msgs::msg::TransformStamped transform;
    transform.header.stamp = now();
    transform.header.frame_id = map_frame_;
    transform.child_frame_id = map_frame_ + "_tiles";
    vehicle::fill_frame(transform.transform, points);
    tiles_frame_.sendTransform(transform);
    PointCloud2 cloud;
    cloud.header.stamp = transform.header.stamp;
    cloud.header.frame_id = transform.child_frame_id;
    vehicle::fill(cloud, points);
    tiles_->publish(cloud);
  }

  void tell() {
    DiagnosticArray message;
    message.header.stamp = now();
    message.status.resize(1);
    vehicle::fill(message.status[0], localizer_.health(), settings_.label);
    diagnostics_->publish(message);
  }

  std::string map_frame_;
  std::string base_frame_;
  bool publishes_tf_;
  std::string cloud_type_;
  vehicle::Settings settings_;
  tf2_ros::Buffer buffer_;
  tf2_ros::TransformListener transforms_;
  tf2_ros::TransformBroadcaster broadcaster_;
  tf2_ros::StaticTransformBroadcaster tiles_frame_;
  rclcpp::Publisher<PoseStamped>::SharedPtr poses_;
  rclcpp::Publisher<PointCloud2>::SharedPtr tiles_;
  rclcpp::Publisher<DiagnosticArray>::SharedPtr diagnostics_;
  vehicle::VehicleLocalizer localizer_;
  // Last, since their callbacks use all of the above.
  rclcpp::GenericSubscription::SharedPtr scans_;
  rclcpp::Subscription<Odometry>::SharedPtr odometry_;
  rclcpp::Subscription<PoseStamped>::SharedPtr initial_poses_;
  rclcpp::TimerBase::SharedPtr timer_;
};

}  // namespace

int main(int count, char** arguments) {
  rclcpp::init(count, arguments);
  try {
    rclcpp::executors::MultiThreadedExecutor executor(rclcpp::ExecutorOptions(), 3);
    const auto node = std::make_shared<Node>();
    executor.add_node(node);
    executor.spin();
  } catch (const std::exception& error) {
    RCLCPP_FATAL(rclcpp::get_logger("stillmap"), "%s", error.what());
    rclcpp::shutdown();
    return 1;
  }
  rclcpp::shutdown();
  return 0;
}
