#include "output/oxts_model.hpp"

#include <stillmap/maps/frames.hpp>

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>
#include <vector>

namespace stillmap::simulation {
namespace {

constexpr double kOxtsRadPerDeg = std::numbers::pi / 180.0;
constexpr double kGravityMS2 = 9.81;

// First packet of KITTI's 2011_09_26_drive_0013.
constexpr double kLatitudeDeg = 49.013141872681;
constexpr double kLongitudeDeg = 8.4378138518088;
constexpr double kAltitudeM = 114.06644439697;

// How long the drifting errors stay alike [s].
constexpr double kPositionCorrelationS = 60.0;
constexpr double kAngleCorrelationS = 30.0;
// White noise: of a filtered solution's steps (position, angles, speed), and of the sensors.
constexpr double kPositionNoiseM = 0.005;
constexpr double kAngleNoiseDeg = 0.005;
constexpr double kVelocityNoiseMS = 0.02;
constexpr double kAccelerationNoiseMS2 = 0.05;
constexpr double kRateNoiseRadS = 0.001;
// The path is smooth over this time, and differences over it lose no digits.
constexpr double kDifferenceS = 0.01;

Eigen::Isometry3d frame_from(const std::vector<double>& row_major, const Eigen::Vector3d& origin) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(row_major.data());
  T.translation() = origin;
  return T;
}

/// Inverse of `maps::roll_pitch_yaw_rad`.
Eigen::Matrix3d rotation_of(const Eigen::Vector3d& angles) {
  return (Eigen::AngleAxisd(angles.z(), Eigen::Vector3d::UnitZ()) *
          Eigen::AngleAxisd(angles.y(), Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(angles.x(), Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

std::string numbers_of(const Eigen::Vector3d& v) {
  return fmt::format(" {:.10g} {:.10g} {:.10g}", v.x(), v.y(), v.z());
}

}  // namespace

double DriftingError::next(double elapsed_s, Random& random) {
  const double kept = value_ ? std::exp(-elapsed_s / correlation_s_) : 0.0;
  value_ = kept * value_.value_or(0.0) + sigma_ * std::sqrt(1.0 - kept * kept) * random.normal();
  return *value_;
}

struct OxtsModel::Motion {
  Eigen::Isometry3d T_world_imu;
  /// In the world.
  Eigen::Vector3d velocity_m_s;
  Eigen::Vector3d acceleration_m_s2;
  /// About the unit's own axes.
  Eigen::Vector3d rate_rad_s;
};

OxtsModel::OxtsModel(TruePath T_world_lidar, Eigen::Isometry3d T_lidar_imu, std::uint64_t key)
    : T_world_lidar_(std::move(T_world_lidar)),
      T_lidar_imu_(std::move(T_lidar_imu)),
      world_(kLatitudeDeg, kLongitudeDeg, kAltitudeM),
      random_(key),
      position_errors_{DriftingError(kHorizontalSigmaM, kPositionCorrelationS),
                       DriftingError(kHorizontalSigmaM, kPositionCorrelationS),
                       DriftingError(kVerticalSigmaM, kPositionCorrelationS)},
      angle_errors_{DriftingError(kTiltSigmaDeg * kOxtsRadPerDeg, kAngleCorrelationS),
                    DriftingError(kTiltSigmaDeg * kOxtsRadPerDeg, kAngleCorrelationS),
                    DriftingError(kYawSigmaDeg * kOxtsRadPerDeg, kAngleCorrelationS)} {}

Eigen::Isometry3d OxtsModel::T_world_imu(double time_s) const {
  return T_world_lidar_(time_s) * T_lidar_imu_;
}

OxtsModel::Motion OxtsModel::motion_at(double time_s) const {
  const Eigen::Isometry3d before = T_world_imu(time_s - kDifferenceS);
  const Eigen::Isometry3d now = T_world_imu(time_s);
  const Eigen::Isometry3d after = T_world_imu(time_s + kDifferenceS);
  const Eigen::AngleAxisd turn(before.linear().transpose() * after.linear());
  return {now, (after.translation() - before.translation()) / (2.0 * kDifferenceS),
          (after.translation() - 2.0 * now.translation() + before.translation()) /
              (kDifferenceS * kDifferenceS),
          turn.angle() * turn.axis() / (2.0 * kDifferenceS)};
}

Eigen::Vector3d OxtsModel::white(double sigma) {
  const double x = random_.normal();
  const double y = random_.normal();
  const double z = random_.normal();
  return sigma * Eigen::Vector3d(x, y, z);
}

Eigen::Vector3d OxtsModel::position_error(double elapsed_s) {
  Eigen::Vector3d error = white(kPositionNoiseM);
  for (int i = 0; i < 3; ++i) {
    error[i] += position_errors_[static_cast<std::size_t>(i)].next(elapsed_s, random_);
  }
  return error;
}

Eigen::Vector3d OxtsModel::angle_error(double elapsed_s) {
  Eigen::Vector3d error = white(kAngleNoiseDeg * kOxtsRadPerDeg);
  for (int i = 0; i < 3; ++i) {
    error[i] += angle_errors_[static_cast<std::size_t>(i)].next(elapsed_s, random_);
  }
  return error;
}

std::string OxtsModel::packet(double time_s) {
  const double elapsed_s = time_s - last_time_s_.value_or(time_s);
  last_time_s_ = time_s;
  const Motion motion = motion_at(time_s);
  const Eigen::Vector3d p = motion.T_world_imu.translation() + position_error(elapsed_s);
  Eigen::Vector3d geodetic;
  std::vector<double> m(9);
  world_.Reverse(p.x(), p.y(), p.z(), geodetic.x(), geodetic.y(), geodetic.z(), m);
  if (!first_geodetic_) first_geodetic_ = geodetic;

  // East, north, up at the place itself, which are not those at the world's origin.
  const Eigen::Matrix3d R_here_world = frame_from(m, p).linear().transpose();
  const Eigen::Vector3d angles =
      maps::roll_pitch_yaw_rad(R_here_world * motion.T_world_imu.linear()) + angle_error(elapsed_s);
  const Eigen::Matrix3d R_here_imu = rotation_of(angles);
  const Eigen::Matrix3d R_ahead_here = rotation_of({0.0, 0.0, -angles.z()});
  const Eigen::Vector3d v = R_here_world * motion.velocity_m_s + white(kVelocityNoiseMS);
  const Eigen::Vector3d v_ahead = R_ahead_here * v;
  // Accelerometers feel what holds the unit up.
  const Eigen::Vector3d force = R_here_imu.transpose() * (R_here_world * motion.acceleration_m_s2 +
                                                          kGravityMS2 * Eigen::Vector3d::UnitZ()) +
                                white(kAccelerationNoiseMS2);
  const Eigen::Vector3d rate = motion.rate_rad_s + white(kRateNoiseRadS);
  const Eigen::Matrix3d R_ahead_imu = R_ahead_here * R_here_imu;

  std::string line =
      fmt::format("{:.12f} {:.12f} {:.10f}", geodetic.x(), geodetic.y(), geodetic.z());
  line += numbers_of({angles.x(), angles.y(), std::remainder(angles.z(), 2.0 * std::numbers::pi)});
  line += fmt::format(" {:.10g} {:.10g}", v.y(), v.x()) + numbers_of(v_ahead);
  line += numbers_of(force) + numbers_of(R_ahead_imu * force);
  line += numbers_of(rate) + numbers_of(R_ahead_imu * rate);
  // Status, satellites and modes as in KITTI's own files.
  return line + fmt::format(" {} {} 4 8 4 4 0\n", kHorizontalSigmaM, kVelocityNoiseMS);
}

Eigen::Isometry3d OxtsModel::T_map_world() const {
  if (!first_geodetic_) throw std::logic_error("OxtsModel::T_map_world: no packet yet");
  const Eigen::Vector3d& g = *first_geodetic_;
  Eigen::Vector3d p;
  std::vector<double> m(9);
  world_.Forward(g.x(), g.y(), g.z(), p.x(), p.y(), p.z(), m);
  return frame_from(m, p).inverse();
}

std::string oxts_dataformat() {
  return "lat:   latitude of the oxts-unit (deg)\n"
         "lon:   longitude of the oxts-unit (deg)\n"
         "alt:   altitude of the oxts-unit (m)\n"
         "roll:  roll angle (rad),    0 = level, positive = left side up,      range: -pi   .. "
         "+pi\n"
         "pitch: pitch angle (rad),   0 = level, positive = front down,        range: -pi/2 .. "
         "+pi/2\n"
         "yaw:   heading (rad),       0 = east,  positive = counter clockwise, range: -pi   .. "
         "+pi\n"
         "vn:    velocity towards north (m/s)\n"
         "ve:    velocity towards east (m/s)\n"
         "vf:    forward velocity, i.e. parallel to earth-surface (m/s)\n"
         "vl:    leftward velocity, i.e. parallel to earth-surface (m/s)\n"
         "vu:    upward velocity, i.e. perpendicular to earth-surface (m/s)\n"
         "ax:    acceleration in x, i.e. in direction of vehicle front (m/s^2)\n"
         "ay:    acceleration in y, i.e. in direction of vehicle left (m/s^2)\n"
         "az:    acceleration in z, i.e. in direction of vehicle top (m/s^2)\n"
         "af:    forward acceleration (m/s^2)\n"
         "al:    leftward acceleration (m/s^2)\n"
         "au:    upward acceleration (m/s^2)\n"
         "wx:    angular rate around x (rad/s)\n"
         "wy:    angular rate around y (rad/s)\n"
         "wz:    angular rate around z (rad/s)\n"
         "wf:    angular rate around forward axis (rad/s)\n"
         "wl:    angular rate around leftward axis (rad/s)\n"
         "wu:    angular rate around upward axis (rad/s)\n"
         "pos_accuracy:  position accuracy (north/east in m)\n"
         "vel_accuracy:  velocity accuracy (north/east in m/s)\n"
         "navstat:       navigation status\n"
         "numsats:       number of satellites tracked by primary GPS receiver\n"
         "posmode:       position mode of primary GPS receiver\n"
         "velmode:       velocity mode of primary GPS receiver\n"
         "orimode:       orientation mode of primary GPS receiver\n";
}

}  // namespace stillmap::simulation
