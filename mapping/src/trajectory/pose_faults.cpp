#include "trajectory/pose_faults.hpp"

#include <fmt/format.h>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr double kLeastOffsetS = 0.05;
constexpr double kLeastScale = 0.01;
constexpr double kLeastTurnRad = 3.0 * std::numbers::pi / 180.0;
constexpr double kSmallTurnRad = 0.35;
constexpr double kLeastLeverM = 0.5;
/// A fault is so many deviations large.
constexpr double kDeviations = 5.0;
/// A turn is told to within this, else it is not named [rad].
constexpr double kObservableTurnRad = 1.5 * std::numbers::pi / 180.0;
constexpr double kObservableLeverM = 0.2;
/// An offset is told to within the first, and where scans are called mirrored the second [s].
constexpr double kObservableOffsetS = 0.02;
constexpr double kObservableOffsetOfMirroredS = 0.05;
/// Poses that belong to the scans at all: so much of what varies in their motion is explained, and
/// so small a part of it is left.
constexpr double kExplained = 0.5;
constexpr double kMostLeft = 0.2;
constexpr double kMostLeftRad = 0.01;
/// The same where a turn of the frame is to be named.
constexpr double kMostLeftOfFrameRad = 0.005;
constexpr double kMostOutliers = 0.25;
/// A clock that drifts leads motions at both ends of a half astray.
constexpr double kMostOutliersOfHalf = 0.5;
/// Mirrored scans explain the poses' turns so well; those of another drive do not.
constexpr double kExplainedMirrored = 0.8;
/// Of two explanations one counts where the logarithm of its likelihood is larger by so much.
constexpr double kLogGain = 10.0;
constexpr double kLogGainEach = 0.35;
constexpr double kMetresPerFoot = 0.3048;

constexpr std::array<const char*, 3> kAxes{"x", "y", "z"};

double degrees(double rad) { return rad * 180.0 / std::numbers::pi; }

bool observes_offset(const PathDifference& apart) {
  return std::max(apart.explained_m, apart.explained_rad) > kExplained;
}

/// Whether both are paths of one drive, and odometry has not lost its way.
bool belongs(const PathDifference& apart, double most_outliers = kMostOutliers) {
  return apart.converged && apart.outlier_share < most_outliers &&
         apart.residual_m < kMostLeft * apart.usual_m && apart.residual_rad < kMostLeftRad;
}

/// Logarithm of how much likelier one explanation is.
double gain_of(const PathDifference& one, const PathDifference& other) {
  return 3.0 * (std::log(other.residual_m / one.residual_m) +
                std::log(other.residual_rad / one.residual_rad));
}

bool is_likelier(const PathDifference& one, const PathDifference& other) {
  const double gain = gain_of(one, other);
  return gain > kLogGainEach && gain * std::min(one.independent, other.independent) > kLogGain;
}

/// Turns an axis round.
Eigen::Matrix3d mirror(int axis) {
  Eigen::Matrix3d mirror = Eigen::Matrix3d::Identity();
  mirror(axis, axis) = -1.0;
  return mirror;
}

/// Which axis, turned round, leaves the least turn between scans and poses; `apart` is that of
/// scans whose y was turned round.
int mirrored_axis(const PathDifference& apart) {
  const auto left_rad = [&](int axis) {
    return maps::rotation_angle_rad(apart.R_given_lidar * mirror(1) * mirror(axis));
  };
  return std::min({0, 1, 2}, [&](int a, int b) { return left_rad(a) < left_rad(b); });
}

std::optional<double> offset_of(const PathDifference& apart) {
  const bool is_fault = observes_offset(apart) && apart.offset_s.sigma < kObservableOffsetS &&
                        std::abs(apart.offset_s.value) > kLeastOffsetS &&
                        apart.offset_s.is_off(0.0, kDeviations);
  return is_fault ? std::optional(apart.offset_s.value) : std::nullopt;
}

/// Short parts tell less: where what fits the whole drive fits better than what is found, it
/// counts.
std::optional<PathDifference> difference_of_part(const PathPair& part, bool mirrored,
                                                 double offset_of_whole_s) {
  const auto found = path_difference(part, mirrored);
  const auto as_whole = path_difference(part, mirrored, offset_of_whole_s);
  return !found || (as_whole && gain_of(*as_whole, *found) > 0.0) ? as_whole : found;
}

/// Of the two halves of the drive, where they differ.
std::optional<std::array<double, 2>> offsets_of_halves(const PathPair& paths, bool mirrored,
                                                       double offset_of_whole_s) {
  const double begin_s = paths.odometry.front().t_s, end_s = paths.odometry.back().t_s;
  const double middle_s = 0.5 * (begin_s + end_s);
  const auto first =
      difference_of_part(part_of(paths, begin_s, middle_s), mirrored, offset_of_whole_s);
  const auto second =
      difference_of_part(part_of(paths, middle_s, end_s), mirrored, offset_of_whole_s);
  if (!first || !second || !observes_offset(*first) || !observes_offset(*second))
    return std::nullopt;
  if (!belongs(*first, kMostOutliersOfHalf) || !belongs(*second, kMostOutliersOfHalf))
    return std::nullopt;
  const double apart_s = std::abs(first->offset_s.value - second->offset_s.value);
  const double sigma_s = std::hypot(first->offset_s.sigma, second->offset_s.sigma);
  if (!(apart_s > kLeastOffsetS && apart_s > kDeviations * sigma_s)) return std::nullopt;
  return std::array{first->offset_s.value, second->offset_s.value};
}

std::optional<double> scale_of(const PathDifference& apart) {
  const Measured& scale = apart.scale;
  const bool is_fault = std::abs(scale.value - 1.0) > kLeastScale &&
                        scale.is_off(1.0, kDeviations) && scale.sigma < kLeastScale * scale.value;
  return is_fault ? std::optional(scale.value) : std::nullopt;
}

/// The turn that is a fault, the identity for none. Of a small one the part that is told: straight
/// on nothing tells a turn about the way.
Eigen::Matrix3d turn_of_frame(const Eigen::Matrix3d& R_given_lidar, const PathDifference& apart) {
  Eigen::Matrix3d none = Eigen::Matrix3d::Identity();
  if (apart.residual_rad > kMostLeftOfFrameRad) return none;
  const maps::SymmetricEigen<3> spread = maps::eigen_of(apart.R_covariance);
  const Eigen::AngleAxisd turn(R_given_lidar);
  Eigen::Vector3d told = Eigen::Vector3d::Zero();
  double sigma_rad = 0.0;
  for (int k = 0; k < 3; ++k) {
    const double sigma_of_axis_rad = std::sqrt(std::max(0.0, spread.values[k]));
    if (sigma_of_axis_rad > kObservableTurnRad) {
      if (turn.angle() > kSmallTurnRad) return none;
      continue;
    }
    const Eigen::Vector3d axis = spread.vectors.col(k);
    told += turn.angle() * turn.axis().dot(axis) * axis;
    sigma_rad = std::max(sigma_rad, sigma_of_axis_rad);
  }
  const double angle_rad = told.norm();
  if (!(angle_rad > std::max(kLeastTurnRad, kDeviations * sigma_rad))) return none;
  return Eigen::AngleAxisd(angle_rad, told / angle_rad).toRotationMatrix();
}

/// @param R_given_lidar  the turn that is left.
std::optional<Eigen::Isometry3d> frame_of(const PathDifference& apart,
                                          const Eigen::Matrix3d& R_given_lidar) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = turn_of_frame(R_given_lidar, apart);
  // Upright the height of a sensor does not show; what is told stands alone then.
  Eigen::Vector3d lever_m = Eigen::Vector3d::Zero();
  for (int axis = 0; axis < 3; ++axis)
    if (apart.lever_sigma_m[axis] < kObservableLeverM) lever_m[axis] = apart.lever_m[axis];
  double sigma_m = 0.0;
  for (int axis = 0; axis < 3; ++axis)
    if (lever_m[axis] != 0.0) sigma_m = std::max(sigma_m, apart.lever_sigma_m[axis]);
  if (lever_m.norm() > std::max(kLeastLeverM, kDeviations * sigma_m)) T.translation() = lever_m;
  if (T.matrix().isIdentity(0.0)) return std::nullopt;
  return T;
}

/// Whether a fit by scans as they are puts the ground above them.
bool puts_ground_above_sensor(const PathDifference& apart, const SeeGround& see_ground) {
  const auto ground = see_ground ? see_ground() : std::nullopt;
  return ground && (ground->R_map_given * apart.R_given_lidar * ground->up_lidar).z() < -0.5;
}

std::string frame_text(const Eigen::Isometry3d& T) {
  // Zero turns -0 into 0.
  const Eigen::Vector3d turn_rad = maps::roll_pitch_yaw_rad(T.linear()) + Eigen::Vector3d::Zero();
  std::string text = fmt::format("roll pitch yaw {:.1f} {:.1f} {:.1f} deg", degrees(turn_rad.x()),
                                 degrees(turn_rad.y()), degrees(turn_rad.z()));
  const Eigen::Vector3d p = T.translation() + Eigen::Vector3d::Zero();
  if (!p.isZero(0.0)) text += fmt::format(", x y z {:.2f} {:.2f} {:.2f} m", p.x(), p.y(), p.z());
  return text;
}

}  // namespace

PoseFaults pose_faults(const PathPair& paths, const SeeGround& see_ground) {
  PoseFaults faults;
  const auto as_is = path_difference(paths);
  if (!as_is) return faults;
  std::optional<PathDifference> turned_round;
  const bool may_be_mirrored = observes_offset(*as_is) || as_is->explained_rad < 0.0;
  if (may_be_mirrored) turned_round = path_difference(paths, true);
  PathDifference apart = *as_is;
  Eigen::Matrix3d R_left = apart.R_given_lidar;
  if (turned_round && belongs(*turned_round) && turned_round->explained_rad > kExplainedMirrored &&
      turned_round->offset_s.sigma < kObservableOffsetOfMirroredS &&
      !is_likelier(*as_is, *turned_round)) {
    const bool by_motion = is_likelier(*turned_round, *as_is);
    if (by_motion || puts_ground_above_sensor(*as_is, see_ground)) {
      apart = *turned_round;
      faults.mirrored_axis = mirrored_axis(apart);
      faults.may_be_z_down = !by_motion;
      R_left = apart.R_given_lidar * mirror(1) * mirror(*faults.mirrored_axis);
    }
  }
  // A clock that runs too fast looks like longer ways as well; one that is set lets the whole drive
  // fit less.
  faults.offsets_of_halves_s =
      offsets_of_halves(paths, faults.mirrored_axis.has_value(), apart.offset_s.value);
  if (faults.offsets_of_halves_s) return faults;
  if (!belongs(apart)) return faults;
  faults.offset_s = offset_of(apart);
  faults.scale = scale_of(apart);
  faults.T_given_lidar = frame_of(apart, R_left);
  return faults;
}

std::vector<maps::DriveFinding> findings_of(const PoseFaults& faults,
                                            const AppliedOffset& applied) {
  std::vector<maps::DriveFinding> findings;
  if (const auto& offset_s = faults.offset_s)
    findings.push_back(
        {"pose_clock",
         fmt::format(
             "the stamps of the poses{} are {:.3f} s {} those of the scans, measured by how the "
             "sensor moves and turns",
             applied.seconds == 0.0 ? "" : fmt::format(", with {:.3f} s added,", applied.seconds),
             std::abs(*offset_s), *offset_s > 0.0 ? "behind" : "ahead of"),
         applied.several_drives
             ? "build with --pose-time-offset auto: a number shifts the poses of all drives"
             : fmt::format("build with --pose-time-offset {:.3f} (or auto)",
                           applied.seconds + *offset_s)});
  if (const auto& halves_s = faults.offsets_of_halves_s)
    findings.push_back(
        {"pose_clocks",
         fmt::format("two clocks: the stamps of the poses fit the scans with {:.3f} s added in "
                     "the first half of the drive, with {:.3f} s in the second",
                     applied.seconds + (*halves_s)[0], applied.seconds + (*halves_s)[1]),
         "record scans and poses by one clock, or build the parts with --select, each with its own "
         "--pose-time-offset (which may leave out first scans: --select counts from the first that "
         "has a pose); --odometry default needs no poses"});
  if (const auto& axis = faults.mirrored_axis)
    findings.push_back(
        {"mirrored_axis",
         fmt::format(
             "the scans have left-handed axes: {} points the wrong way{}",
             kAxes[static_cast<std::size_t>(*axis)],
             faults.may_be_z_down ? ", or the poses are of a frame whose z is down (NED)" : ""),
         fmt::format("negate the {} of all points{}", kAxes[static_cast<std::size_t>(*axis)],
                     faults.may_be_z_down ? ", or give poses whose z is up" : "")});
  if (const auto& scale = faults.scale) {
    const bool is_feet = std::abs(*scale * kMetresPerFoot - 1.0) < kLeastScale;
    findings.push_back(
        {"pose_scale",
         fmt::format("ways between poses are {:.4f} times as long as the scans say{}", *scale,
                     is_feet ? ": feet" : ""),
         fmt::format("give positions in metres: multiply them by {:.4f}",
                     is_feet ? kMetresPerFoot : 1.0 / *scale)});
  }
  if (const auto& T = faults.T_given_lidar)
    findings.push_back(
        {"pose_frame",
         fmt::format(
             "the poses are of another frame than the lidar's; in that frame the lidar is at {}",
             frame_text(*T)),
         "give T_map_lidar = T_given * T, where T is this transform; for a bag add "
         "?pose_frame=FRAME"});
  return findings;
}

}  // namespace stillmap::mapping
