#pragma once

#include <GeographicLib/LocalCartesian.hpp>

#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "geometry/random.hpp"
#include "sensing/simulated_scan.hpp"

namespace stillmap::simulation {

/// An error that is remembered for a while: a first-order Gauss-Markov process, which has the same
/// standard deviation at all times.
class DriftingError {
 public:
  DriftingError(double sigma, double correlation_s)
      : sigma_(sigma), correlation_s_(correlation_s) {}

  /// The error `elapsed_s` after the last one.
  double next(double elapsed_s, Random& random);

 private:
  double sigma_;
  double correlation_s_;
  std::optional<double> value_;
};

/// What an inertial unit with satellite positioning (OXTS RT3003, as in KITTI) reports on a path.
///
/// Errors of position and attitude drift (Gauss-Markov) and have some white noise on top; speeds,
/// accelerations and rates are differences of the true path with white noise. The world's origin
/// lies at a place in Karlsruhe.
class OxtsModel {
 public:
  // Standard deviations of the drifting errors: those of a good fix in a street.
  static constexpr double kHorizontalSigmaM = 0.10;
  static constexpr double kVerticalSigmaM = 0.20;
  static constexpr double kYawSigmaDeg = 0.1;
  static constexpr double kTiltSigmaDeg = 0.03;

  OxtsModel(TruePath T_world_lidar, Eigen::Isometry3d T_lidar_imu, std::uint64_t key);

  /// The packet of a time, one after the other: 30 numbers as `dataformat.txt` names them.
  [[nodiscard]] std::string packet(double time_s);

  /// Readers put the map's origin where the first packet says it is, with its up and north.
  /// @throws std::logic_error before the first packet.
  [[nodiscard]] Eigen::Isometry3d T_map_world() const;

 private:
  struct Motion;
  [[nodiscard]] Eigen::Isometry3d T_world_imu(double time_s) const;
  [[nodiscard]] Motion motion_at(double time_s) const;
  [[nodiscard]] Eigen::Vector3d position_error(double elapsed_s);
  [[nodiscard]] Eigen::Vector3d angle_error(double elapsed_s);
  [[nodiscard]] Eigen::Vector3d white(double sigma);

  TruePath T_world_lidar_;
  Eigen::Isometry3d T_lidar_imu_;
  GeographicLib::LocalCartesian world_;
  Random random_;
  /// East, north, up [m]; roll, pitch, yaw [rad].
  std::array<DriftingError, 3> position_errors_;
  std::array<DriftingError, 3> angle_errors_;
  std::optional<double> last_time_s_;
  std::optional<Eigen::Vector3d> first_geodetic_;
};

/// `dataformat.txt`: what the 30 numbers are.
[[nodiscard]] std::string oxts_dataformat();

}  // namespace stillmap::simulation
