#include "odometry/imu_clock.hpp"

#include "odometry/run_odometry.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Fewer turns tell nothing.
constexpr std::size_t kLeastTurns = 20;
/// Scans that are followed for the fit: half a minute.
constexpr std::size_t kFitScans = 300;
/// Median turn between two scans below which the clock's offset is not looked for [rad]: 1 deg/s.
constexpr double kTurningRad = 0.0017;
/// A gyroscope fits if it is off by less than this, or this share of the turns [rad].
constexpr double kMostOffRad = 0.006;
constexpr double kMostOffShare = 0.25;
constexpr double kCoarseOffsetStepS = 0.01;
constexpr double kFineOffsetStepS = 0.0005;

std::int64_t ns_of(double s) { return std::llround(1e9 * s); }

/// How far the gyroscope's rates are from those of the scans [rad/s], over steps from scan to scan.
struct RateDifferences {
  std::vector<Eigen::Vector3d> rates;
  std::vector<double> steps_s;
};

RateDifferences rate_differences(std::span<const ScanTurn> turns,
                                 std::span<const maps::ImuReading> readings, double offset_s) {
  RateDifferences found;
  const maps::Imu::Fit fit{ns_of(offset_s), Eigen::Vector3d::Zero()};
  for (const ScanTurn& turn : turns) {
    const auto R = maps::turn_between_stamps(readings, fit, turn.from_ns, turn.to_ns);
    if (!R) continue;
    const double step_s = 1e-9 * static_cast<double>(turn.to_ns - turn.from_ns);
    found.rates.push_back(maps::log_so3(turn.R_from_to.transpose() * *R) / step_s);
    found.steps_s.push_back(step_s);
  }
  return found;
}

Eigen::Vector3d median_vector(const std::vector<Eigen::Vector3d>& vectors) {
  Eigen::Vector3d median;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const Eigen::Vector3d& vector : vectors) values.push_back(vector[axis]);
    median[axis] = maps::median(std::move(values));
  }
  return median;
}

/// An offset, how well it fits, and the bias with it.
struct TriedOffset {
  double offset_s = 0.0;
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();
  /// Mean and median difference a step [rad].
  double cost = std::numeric_limits<double>::infinity();
  double median_rad = 0.0;
  std::size_t turns = 0;
};

TriedOffset with_offset(std::span<const ScanTurn> turns, std::span<const maps::ImuReading> readings,
                        double offset_s) {
  TriedOffset result;
  result.offset_s = offset_s;
  const RateDifferences found = rate_differences(turns, readings, offset_s);
  result.turns = found.rates.size();
  if (result.turns < kLeastTurns) return result;
  result.bias = median_vector(found.rates);
  std::vector<double> off_rad;
  double sum = 0.0;
  for (std::size_t i = 0; i < found.rates.size(); ++i) {
    off_rad.push_back((found.rates[i] - result.bias).norm() * found.steps_s[i]);
    // A few wrong scans count little.
    sum += std::min(off_rad.back(), 0.05);
  }
  result.cost = sum / static_cast<double>(result.turns);
  result.median_rad = maps::median(std::move(off_rad));
  return result;
}

/// The best of offsets on both sides of a middle.
TriedOffset best_around(std::span<const ScanTurn> turns, std::span<const maps::ImuReading> readings,
                        double middle_s, double reach_s, double step_s) {
  TriedOffset best = with_offset(turns, readings, middle_s);
  const int steps = static_cast<int>(std::lround(reach_s / step_s));
  for (int i = 1; i <= steps; ++i) {
    for (const double side : {-1.0, 1.0}) {
      const TriedOffset other = with_offset(turns, readings, middle_s + side * i * step_s);
      if (other.cost < best.cost) best = other;
    }
  }
  return best;
}

double median_turn_rad(std::span<const ScanTurn> turns) {
  std::vector<double> angles;
  for (const ScanTurn& turn : turns) angles.push_back(maps::rotation_angle_rad(turn.R_from_to));
  return angles.empty() ? 0.0 : maps::median(std::move(angles));
}

bool does_fit(const ImuCheck& check) {
  return check.off_rad <= std::max(kMostOffRad, kMostOffShare * check.turn_rad);
}

constexpr double kDegPerRad = 180.0 / std::numbers::pi;

std::string why_unused(const maps::Imu& imu, const std::optional<ImuCheck>& check) {
  if (!check)
    return fmt::format(
        "{} is not used: it has no readings at the stamps of the first scans, or "
        "fewer than 20 a second",
        imu.source);
  return fmt::format(
      "{} is not used: its turns differ from those of the scans by {:.2f} deg a scan "
      "(of {:.2f} deg); check the mount of the IMU in tf_static",
      imu.source, kDegPerRad * check->off_rad, kDegPerRad * check->turn_rad);
}

std::string fit_text(const maps::Imu& imu, const ImuCheck& check) {
  const Eigen::Vector3d bias = kDegPerRad * check.fit.bias_radps;
  return fmt::format(
      "{} is used: {:.0f} Hz, {:+.4f} s added to its stamps, bias of its gyroscope "
      "{:.2f} {:.2f} {:.2f} deg/s, {:.3f} deg a scan from the turns of the scans",
      imu.source, imu.rate_hz(), 1e-9 * static_cast<double>(check.fit.clock_offset_ns), bias.x(),
      bias.y(), bias.z(), kDegPerRad * check.off_rad);
}

maps::Drive with_note(const maps::Drive& drive, std::string note) {
  maps::Drive::Contents contents = drive.contents();
  contents.notes.push_back(std::move(note));
  return maps::Drive(std::move(contents));
}

std::vector<ScanTurn> turns_of(const maps::Drive& drive, const std::vector<OdometryPose>& poses) {
  std::vector<ScanTurn> turns;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    if (poses[i].status == OdometryStatus::kPredicted) continue;
    turns.push_back(
        {drive.stamp_ns(i - 1), drive.stamp_ns(i),
         poses[i - 1].T_odom_lidar.linear().transpose() * poses[i].T_odom_lidar.linear()});
  }
  return turns;
}

}  // namespace

std::optional<ImuCheck> fit_imu(std::span<const ScanTurn> turns,
                                std::span<const maps::ImuReading> readings) {
  const double turn_rad = median_turn_rad(turns);
  TriedOffset best;
  if (turn_rad < kTurningRad) {
    best = with_offset(turns, readings, 0.0);
  } else {
    best = best_around(turns, readings, 0.0, kMostClockOffsetS, kCoarseOffsetStepS);
    best = best_around(turns, readings, best.offset_s, kCoarseOffsetStepS, kFineOffsetStepS);
  }
  if (best.turns < kLeastTurns) return std::nullopt;
  return ImuCheck{{ns_of(best.offset_s), best.bias}, best.median_rad, turn_rad, best.turns};
}

maps::Drive with_fitted_imu(const maps::Drive& drive, int threads, const ProgressCallback& progress,
                            const CancelFlag& cancel) {
  const std::shared_ptr<const maps::Imu>& imu = drive.contents().imu;
  if (!imu || imu->fit) return drive;
  maps::Drive fitted = drive.with_imu(nullptr);
  std::optional<ImuCheck> check;
  // With the first fit sweeps are straight, which tells the second one more exactly.
  for (int round = 0; round < 2; ++round) {
    const std::vector<OdometryPose> poses =
        run_odometry({.drive = fitted, .begin = 0, .end = std::min(kFitScans, drive.size())},
                     threads, progress, cancel);
    check = fit_imu(turns_of(drive, poses), *imu->readings);
    if (!check || !does_fit(*check))
      return with_note(drive.with_imu(nullptr), why_unused(*imu, check));
    auto with_fit = std::make_shared<maps::Imu>(*imu);
    with_fit->fit = check->fit;
    fitted = drive.with_imu(std::move(with_fit));
  }
  return with_note(fitted, fit_text(*imu, *check));
}

}  // namespace stillmap::mapping
