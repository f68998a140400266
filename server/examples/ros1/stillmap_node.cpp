// A node of ROS 1 that localizes a vehicle by a stillmap server: see ../README.md.

#include <diagnostic_msgs/DiagnosticArray.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>
#include <topic_tools/shape_shifter.h>

#include <cstdlib>
#include <vector>

#include "ros_messages.hpp"
#include "vehicle_localizer.hpp"

namespace {

using namespace stillmap;

std::int64_t nanoseconds_of(const ros::Time& time) {
  return static_cast<std::int64_t>(time.toNSec());
}

ros::Time time_of(std::int64_t stamp_ns) {
  ros::Time time;
  time.fromNSec(static_cast<std::uint64_t>(stamp_ns));
  return time;
}

std::chrono::milliseconds milliseconds_of(double seconds) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(1000.0 * seconds));
}

class Node {
 public:
  Node()
      : private_("~"),
        map_frame_(private_.param<std::string>("map_frame", "map")),
        base_frame_(private_.param<std::string>("base_frame", "base_link")),
        publishes_tf_(private_.param("publish_tf", true)),
        settings_(settings()),
        transforms_(buffer_),
        poses_(private_.advertise<geometry_msgs::PoseWithCovarianceStamped>("pose", 10)),
        tiles_(private_.advertise<sensor_msgs::PointCloud2>("map_tiles", 1, true)),
        diagnostics_(public_.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 10)),
        localizer_(settings_,
                   {[this](const std::string& lidar_frame) { return find_mount(lidar_frame); },
                    [this](const vehicle::Estimate& estimate) { publish(estimate); },
                    [this](const vehicle::MapPoints& points) { publish(points); }}),
        // Of scans that wait only the newest is of use.
        scans_(public_.subscribe("points", 1, &Node::on_scan, this,
                                 ros::TransportHints().tcpNoDelay())),
        odometry_(public_.subscribe("odom", 100, &Node::on_odometry, this,
                                    ros::TransportHints().tcpNoDelay())),
        initial_poses_(public_.subscribe("initialpose", 1, &Node::on_initial_pose, this)),
        // By the wall: a recording may stand still.
        timer_(public_.createWallTimer(ros::WallDuration(0.5), &Node::tell, this)) {}

 private:
  vehicle::Settings settings() const {
    vehicle::Settings settings;
    const char* const key = std::getenv("STILLMAP_KEY");
    settings.url = private_.param("url", settings.url);
    settings.key = private_.param<std::string>("key", key == nullptr ? "" : key);
    settings.map = private_.param("map", settings.map);
    settings.version = private_.param("version", settings.version);
    settings.label = private_.param("label", ros::this_node::getName());
    settings.thin = vehicle::thin_profile_of(private_.param<std::string>("thin", "exact"));
    settings.own_vehicle_m = private_.param("own_vehicle_m", settings.own_vehicle_m);
    settings.deadline = milliseconds_of(private_.param("deadline_s", 1.0));
    settings.patience = milliseconds_of(private_.param("patience_s", 2.0));
    settings.odometry_sigma_m = private_.param("odometry_sigma_m", 0.0);
    settings.odometry_sigma_rad = private_.param("odometry_sigma_rad", 0.0);
    settings.tile_radius_m = private_.param("tile_radius_m", 60.0);
    return settings;
  }

  void on_scan(const topic_tools::ShapeShifter::ConstPtr& message) {
    std::vector<std::uint8_t> bytes(message->size());
    ros::serialization::OStream stream(bytes.data(), message->size());
    message->write(stream);
    localizer_.take_ros1_scan(message->getDataType(), bytes.data(), bytes.size(),
                              scans_.getTopic());
  }

  std::optional<Eigen::Isometry3d> find_mount(const std::string& lidar_frame) {
    try {
      const auto mount = buffer_.lookupTransform(base_frame_, lidar_frame, ros::Time(0));
      return vehicle::motion_of_transform(mount.transform);
    } catch (const tf2::TransformException& error) {
      ROS_WARN_THROTTLE(5.0, "no transform from %s to %s yet: %s", base_frame_.c_str(),
                        lidar_frame.c_str(), error.what());
      return std::nullopt;
    }
  }

  void on_odometry(const nav_msgs::Odometry& message) {
    const auto T_odom_base = vehicle::motion_of(message.pose.pose);
    if (!T_odom_base) {
      ROS_WARN_THROTTLE(5.0, "odometry without a rotation is left out");
      return;
    }
    if (!message.child_frame_id.empty() && message.child_frame_id != base_frame_)
      ROS_WARN_ONCE("odometry is of %s, not of %s: set base_frame", message.child_frame_id.c_str(),
                    base_frame_.c_str());
    localizer_.take_odometry(nanoseconds_of(message.header.stamp), *T_odom_base);
    const auto T_map_odom = localizer_.T_map_odom();
    if (!publishes_tf_ || !T_map_odom) return;
    geometry_msgs::TransformStamped transform;
    transform.header.stamp = message.header.stamp;
    transform.header.frame_id = map_frame_;
    transform.child_frame_id = message.header.frame_id;
    vehicle::fill(transform.transform.translation, transform.transform.rotation, *T_map_odom);
    broadcaster_.sendTransform(transform);
  }

  void on_initial_pose(const geometry_msgs::PoseWithCovarianceStamped& message) {
    const auto T_map_base = vehicle::motion_of(message.pose.pose);
    if (message.header.frame_id != map_frame_ || !T_map_base) {
      ROS_ERROR("initial pose in frame '%s' is refused: give a rotation, and the frame '%s'",
                message.header.frame_id.c_str(), map_frame_.c_str());
      return;
    }
    if (!localizer_.initialize(*T_map_base, vehicle::matrix_of(message.pose.covariance)))
      ROS_ERROR("the initial pose came before the lidar's transform: give it again");
  }

  void publish(const vehicle::Estimate& estimate) {
    geometry_msgs::PoseWithCovarianceStamped message;
    message.header.stamp = time_of(estimate.stamp_ns);
    message.header.frame_id = map_frame_;
    vehicle::fill(message.pose, estimate);
    poses_.publish(message);
  }

  void publish(const vehicle::MapPoints& points) {
    geometry_msgs::TransformStamped transform;
    transform.header.stamp = ros::Time::now();
    transform.header.frame_id = map_frame_;
    transform.child_frame_id = map_frame_ + "_tiles";
    vehicle::fill_frame(transform.transform, points);
    tiles_frame_.sendTransform(transform);
    sensor_msgs::PointCloud2 cloud;
    cloud.header.stamp = transform.header.stamp;
    cloud.header.frame_id = transform.child_frame_id;
    vehicle::fill(cloud, points);
    tiles_.publish(cloud);
  }

  void tell(const ros::WallTimerEvent&) {
    diagnostic_msgs::DiagnosticArray message;
    message.header.stamp = ros::Time::now();
    message.status.resize(1);
    vehicle::fill(message.status[0], localizer_.health(), settings_.label);
    diagnostics_.publish(message);
  }

  ros::NodeHandle public_;
  ros::NodeHandle private_;
  std::string map_frame_;
  std::string base_frame_;
  bool publishes_tf_;
  vehicle::Settings settings_;
  tf2_ros::Buffer buffer_;
  tf2_ros::TransformListener transforms_;
  tf2_ros::TransformBroadcaster broadcaster_;
  tf2_ros::StaticTransformBroadcaster tiles_frame_;
  ros::Publisher poses_;
  ros::Publisher tiles_;
  ros::Publisher diagnostics_;
  vehicle::VehicleLocalizer localizer_;
  // Last, since their callbacks use all of the above.
  ros::Subscriber scans_;
  ros::Subscriber odometry_;
  ros::Subscriber initial_poses_;
  ros::WallTimer timer_;
};

}  // namespace

int main(int count, char** arguments) {
  ros::init(count, arguments, "stillmap");
  try {
    Node node;
    // Decoding a scan must not hold odometry back.
    constexpr int kThreads = 3;
    ros::AsyncSpinner spinner(kThreads);
    spinner.start();
    ros::waitForShutdown();
    spinner.stop();
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
  return 0;
}
