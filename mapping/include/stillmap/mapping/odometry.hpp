#pragma once

#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// How a scan was placed.
enum class OdometryStatus {
  kMatched,    ///< on what the scans before it saw
  kPartly,     ///< so, but along some directions the scan tells nothing: those are predicted
  kPredicted,  ///< by the motion alone: too few points, or no match
};
[[nodiscard]] std::string_view name_of(OdometryStatus status);

/// Where a scan was taken, as far as the scans before it tell.
struct OdometryPose {
  OdometryStatus status = OdometryStatus::kPredicted;
  /// At the scan's stamp. `odom` is the lidar frame of the first scan; near it where that is
  /// hidden.
  Eigen::Isometry3d T_odom_lidar = Eigen::Isometry3d::Identity();
  /// Of the motion since the scan before, rows tx ty tz [m], rx ry rz [rad]; perturbation on the
  /// right, in the lidar frame. Zero for the first scan.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  /// (tx ty tz rx ry rz) [m/s, rad/s] during the sweep, in the lidar frame: what `maps::deskew`
  /// asks for.
  Eigen::Matrix<double, 6, 1> twist_lidar = Eigen::Matrix<double, 6, 1>::Zero();
  /// Unit directions that the scan does not tell, as in `localization::AlignmentResult`.
  std::vector<Eigen::Matrix<double, 6, 1>> degenerate_directions;
  /// Share of the thinned scan's points that lie on what the scans before it saw, in [0, 1].
  double inlier_ratio = 0.0;
  /// The scan shows next to nothing of what the scans before it saw: a covered sensor, dust, a
  /// frame that was sent again. Status `kPredicted`; the scan tells nothing to those after it.
  bool hidden = false;
  /// After hidden scans nothing of what was seen before them was found again: followed anew from
  /// here. Status `kPredicted`, and the motion over the gap is a guess.
  bool begins_anew = false;
};

/// Follows one sensor from scan to scan. Memory does not grow with the drive.
class Odometry {
 public:
  /// What can be done to a scan before those ahead of it are placed.
  struct Prepared {
    virtual ~Prepared() = default;
  };

  virtual ~Odometry() = default;
  Odometry() = default;
  Odometry(const Odometry&) = delete;
  Odometry& operator=(const Odometry&) = delete;

  /// @param scan  as `Drive::read` gives it: with times of the points where the layout tells, not
  /// deskewed; may be empty.
  /// @throws maps::InputError naming the scan's source where the method cannot use such a sensor.
  /// @note  Pure, safe from several threads.
  [[nodiscard]] virtual std::unique_ptr<Prepared> prepare(const maps::Scan& scan) const = 0;
  /// How the sensor moves at the first scan, where something tells, before the first `add`: a scan
  /// alone is thin, and rings of ground around a sensor look like one that stands.
  /// @param twist_lidar  (tx ty tz rx ry rz) [m/s, rad/s], lidar frame; finite.
  virtual void start_with(const Eigen::Matrix<double, 6, 1>& twist_lidar) = 0;
  /// How the sensor moved since the scan before, where something else tells (given poses), before
  /// the next `add`: the scan is looked for there, and stays there along what it does not tell.
  /// A method may leave it unused. @param T_before_this  finite.
  virtual void expect(const Eigen::Isometry3d& T_before_this) { (void)T_before_this; }
  /// How the sensor turned since the scan before, where a gyroscope tells it, before the next
  /// `add`: the scan is looked for at this orientation, and where the speed leads.
  /// @param R_before_this  a rotation.
  virtual void turned(const Eigen::Matrix3d& R_before_this) = 0;
  /// The next scan. @param prepared  by this object. Stamps must increase.
  /// @throws std::invalid_argument naming a stamp that does not increase.
  [[nodiscard]] virtual OdometryPose add(const Prepared& prepared) = 0;
};

/// Names for `make_odometry`, the default first.
[[nodiscard]] std::vector<std::string> odometry_names();

/// @throws std::invalid_argument naming the method and the choices.
[[nodiscard]] std::unique_ptr<Odometry> make_odometry(std::string_view method);

}  // namespace stillmap::mapping
