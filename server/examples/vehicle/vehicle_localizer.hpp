#pragma once

#include <Eigen/Geometry>

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "stillmap_client.hpp"

/// What a node of ROS 1 and one of ROS 2 have in common: a vehicle that asks a stillmap server
/// where it is. It needs no ROS, and its headers only C++17, as those of ROS 1 do.
///
/// Frames: `lidar` and `base` are the vehicle's, `map` is the server's map. `odom` is the frame of
/// the vehicle's odometry, which drifts.
namespace stillmap::vehicle {

/// 6x6 as ROS has it: x y z [m], then turns about the axes X Y Z of the parent frame [rad].
using Matrix6d = Eigen::Matrix<double, 6, 6>;

struct Settings {
  std::string url = "http://127.0.0.1:8080";
  /// Empty = the server wants none.
  std::string key;
  std::string map;
  /// Empty = the active one.
  std::string version;
  /// What the server's operators see.
  std::string label;
  /// Nothing = whole scans.
  std::optional<localization::ThinProfile> thin = localization::ThinProfile::kExact;
  /// As the server's option: points closer than this are the vehicle itself.
  double own_vehicle_m = localization::kOwnVehicleM;
  /// After it the server gives a scan up.
  std::chrono::milliseconds deadline{1000};
  /// One standard deviation of odometry from scan to scan. 0 = not known: the server then takes
  /// 0.1 m and a tenth of the step, and 0.05 rad.
  double odometry_sigma_m = 0.0;
  double odometry_sigma_rad = 0.0;
  /// After so long without a scan or a pose, health is an error, and there is no `T_map_odom`.
  std::chrono::milliseconds patience{2000};
  /// Map tiles within this distance of the vehicle are fetched. 0 = none.
  double tile_radius_m = 0.0;
};

/// Where the vehicle was at a scan. Lost scans give none.
struct Estimate {
  std::int64_t stamp_ns = 0;
  Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
  /// About the axes of the map.
  Matrix6d covariance = Matrix6d::Identity();
  /// `ok` without it.
  bool degraded = false;
};

/// Points of the map around the vehicle.
struct MapPoints {
  /// Where they count from, in the map frame [m]: a place near the vehicle, since floats grow
  /// coarse far from it. It stays until the vehicle has gone on for some hundred metres.
  Eigen::Vector3d origin_map = Eigen::Vector3d::Zero();
  /// x y z from there [m], and intensity.
  std::vector<std::array<float, 4>> points;
};

enum class HealthLevel : std::uint8_t { kOk, kWarn, kError };

/// How localization is, for an operator.
struct Health {
  HealthLevel level = HealthLevel::kOk;
  std::string message;
  std::vector<std::pair<std::string, std::string>> values;
};

/// Streams the vehicle's scans to the server. Its functions may be called from any thread and do
/// not wait for the network: of the scans that come faster than the server answers, the newest is
/// sent. After a lost connection it goes on by itself.
class VehicleLocalizer {
 public:
  /// What it asks and tells; none may throw.
  struct Callbacks {
    /// Where the lidar is mounted: T_base_lidar, by the frame that its scans name. Asked at each
    /// scan until it knows; scans before that are dropped.
    std::function<std::optional<Eigen::Isometry3d>(const std::string& lidar_frame)> find_mount;
    /// In the sending thread.
    std::function<void(const Estimate&)> on_estimate;
    /// In a thread of its own, when other tiles are around the vehicle.
    std::function<void(const MapPoints&)> on_map_points;
  };

  /// @throws std::invalid_argument for settings that cannot be.
  VehicleLocalizer(Settings settings, Callbacks callbacks);
  VehicleLocalizer(const VehicleLocalizer&) = delete;
  VehicleLocalizer& operator=(const VehicleLocalizer&) = delete;
  /// Ends the session.
  ~VehicleLocalizer();

  /// The bytes of a message that holds a scan, as ROS 1 or 2 sends it. It is sent with the motion
  /// since the last pose where odometry tells it. One that cannot be read is counted, and health
  /// says why.
  /// @param type  such as `sensor_msgs/PointCloud2`. @param topic  for messages.
  void take_ros1_scan(const std::string& type, const std::uint8_t* bytes, std::size_t size,
                      const std::string& topic);
  void take_ros2_scan(const std::string& type, const std::uint8_t* bytes, std::size_t size,
                      const std::string& topic);
  void take_odometry(std::int64_t stamp_ns, const Eigen::Isometry3d& T_odom_base);
  /// Where somebody says that the vehicle is. A row of zeros in the covariance means "not told", as
  /// RViz has z, roll and pitch; z is then that of the map's ground at this place.
  /// @return false before the mount is known: then nothing has changed.
  bool initialize(const Eigen::Isometry3d& T_map_base, const Matrix6d& covariance_map);

  /// Corrects the drift of the odometry; nothing before the first pose, and when none has come for
  /// `patience`.
  [[nodiscard]] std::optional<Eigen::Isometry3d> T_map_odom() const;
  [[nodiscard]] Health health() const;

 private:
  class Work;
  std::unique_ptr<Work> work_;
};

/// @param name  `exact`, `compact`, or `none` for whole scans. @throws std::invalid_argument for
/// others.
[[nodiscard]] std::optional<localization::ThinProfile> thin_profile_of(const std::string& name);

/// T_map_base and its covariance about the axes of the map -> the server's prior: T_map_lidar and
/// a covariance of a perturbation on the right. Rows of zeros become 2 m or 0.13 rad first.
[[nodiscard]] client::Prior prior_of(const Eigen::Isometry3d& T_map_base,
                                     const Matrix6d& covariance_map,
                                     const Eigen::Isometry3d& T_base_lidar);

/// The way back, of an answer that is not lost.
[[nodiscard]] Estimate estimate_of(std::int64_t stamp_ns, const client::PoseAnswer& answer,
                                   const Eigen::Isometry3d& T_base_lidar);

}  // namespace stillmap::vehicle
