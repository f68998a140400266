#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// A motion and how well it is known: rows tx ty tz [m], rx ry rz [rad], perturbation on the right.
struct UncertainMotion {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

/// Covariance of Ad(T) x: of a perturbation moved from the right of T to its left.
[[nodiscard]] Eigen::Matrix<double, 6, 6> carried(const Eigen::Isometry3d& T,
                                                  const Eigen::Matrix<double, 6, 6>& covariance);

/// T = a.T b.T, errors of the two independent.
[[nodiscard]] UncertainMotion composed(const UncertainMotion& a, const UncertainMotion& b);
/// The motion back.
[[nodiscard]] UncertainMotion inverted(const UncertainMotion& motion);

/// Squared Mahalanobis length of what lies between two motions, by both covariances; chi-squared
/// of six degrees of freedom where they are right. Infinite where they are none.
[[nodiscard]] double chi_squared(const UncertainMotion& a, const UncertainMotion& b);

/// The keyframes as odometry has them, and how far it may have drifted between any two.
class OdometryPath {
 public:
  /// @param motion_covariance  of the motion since the keyframe before, perturbation on the right.
  void append(const Eigen::Isometry3d& T_odom_lidar,
              const Eigen::Matrix<double, 6, 6>& motion_covariance, std::uint32_t drive);

  [[nodiscard]] std::size_t size() const { return nodes_.size(); }
  [[nodiscard]] std::uint32_t drive(std::size_t keyframe) const { return nodes_[keyframe].drive; }
  [[nodiscard]] const Eigen::Isometry3d& T_odom_lidar(std::size_t keyframe) const {
    return nodes_[keyframe].T_odom_lidar;
  }
  /// Way since the first keyframe of its drive [m].
  [[nodiscard]] double travelled_m(std::size_t keyframe) const {
    return nodes_[keyframe].travelled_m;
  }
  /// Way between two keyframes of one drive [m]; infinite between drives.
  [[nodiscard]] double way_m(std::size_t a, std::size_t b) const;

  /// T_from_to by odometry alone. The covariance is the sum of those of the steps, carried to `to`,
  /// and a share of the way on top, since errors that steps share (a scale, a calibration) grow
  /// with the way and not with its root.
  /// @param from, to  of one drive, in any order.
  [[nodiscard]] UncertainMotion motion(std::size_t from, std::size_t to) const;
  /// What odometry's own covariances come to on a metre of the stretch, in the lidar frames on the
  /// way, without any share; zero where it has no length.
  [[nodiscard]] Eigen::Matrix<double, 6, 6> covariance_per_m(std::size_t from,
                                                             std::size_t to) const;
  /// Deviation of the share alone, on an axis [m].
  [[nodiscard]] static double least_drift_m(double way_m);

 private:
  struct Node {
    Eigen::Isometry3d T_odom_lidar;
    std::uint32_t drive = 0;
    double travelled_m = 0.0;
    /// Sum of the covariances of the steps so far, as perturbations on the left (exp(x) T), so
    /// that any stretch is a difference of two.
    Eigen::Matrix<double, 6, 6> sum;
    /// The same as they came.
    Eigen::Matrix<double, 6, 6> own_sum;
  };
  std::vector<Node> nodes_;
};

}  // namespace stillmap::mapping
