#include "odometry/imu_clock.hpp"

#include "odometry/run_odometry.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Scans that are followed for the fit: half a minute.
constexpr std::size_t kFitScans = 300;
/// The fit may begin at every such scan.
constexpr std::size_t kWindowStep = 100;
/// Most that a step from scan to scan counts, however much it differs [rad]: a few wrong scans
/// count little.
constexpr double kMostCountedRad = 0.05;
/// An IMU is used only if its gyroscope explains this share of the turns of the scans.
/// mapping/odometry.md tells what right and wrong ones explain.
constexpr double kLeastExplained = 0.6;
/// An IMU is used only if its clock offset is known to this [s].
constexpr double kMostOffsetSigmaS = 0.01;
/// Largest bias that data sheets of small IMUs allow [rad/s]: 5 deg/s.
constexpr double kMostBiasRadps = 0.0873;
/// Scans that turn less tell nothing about an IMU [rad].
constexpr double kTurningRad = 0.001;
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
  /// Mean, mean square and median of the differences a step [rad, rad^2].
  double cost = std::numeric_limits<double>::infinity();
  double square_rad2 = 0.0;
  double median_rad = 0.0;
  std::size_t turns = 0;
};

TriedOffset with_offset(std::span<const ScanTurn> turns, std::span<const maps::ImuReading> readings,
                        double offset_s) {
  TriedOffset result;
  result.offset_s = offset_s;
  const RateDifferences found = rate_differences(turns, readings, offset_s);
  result.turns = found.rates.size();
  if (result.turns < kLeastImuTurns) return result;
  result.bias = median_vector(found.rates);
  std::vector<double> off_rad;
  double sum = 0.0, squares = 0.0;
  for (std::size_t i = 0; i < found.rates.size(); ++i) {
    off_rad.push_back((found.rates[i] - result.bias).norm() * found.steps_s[i]);
    const double counted = std::min(off_rad.back(), kMostCountedRad);
    sum += counted;
    squares += counted * counted;
  }
  result.cost = sum / static_cast<double>(result.turns);
  result.square_rad2 = squares / static_cast<double>(result.turns);
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

/// What a gyroscope that stands still would differ by, over the steps that the readings cover.
TriedOffset of_dead_gyroscope(std::span<const ScanTurn> turns,
                              std::span<const maps::ImuReading> readings, double offset_s) {
  std::vector<maps::ImuReading> dead(readings.begin(), readings.end());
  for (maps::ImuReading& reading : dead) reading.rate_radps.setZero();
  return with_offset(turns, dead, offset_s);
}

/// From how much the turns change with the offset, and how differently ten parts of the drive pull
/// it: errors of neighbouring scans are alike.
double offset_sigma_s(std::span<const ScanTurn> turns, std::span<const maps::ImuReading> readings,
                      const TriedOffset& best) {
  constexpr double kAsideS = 0.025;
  /// Median length of three normal errors.
  constexpr double kMedianLength = 1.538;
  constexpr std::size_t kParts = 10;
  double information = 0.0;
  std::array<double, kParts> pulls{};
  for (std::size_t i = 0; i < turns.size(); ++i) {
    const auto with = [&](double offset_s) {
      return maps::turn_between_stamps(readings, {ns_of(offset_s), best.bias}, turns[i].from_ns,
                                       turns[i].to_ns);
    };
    const auto before = with(best.offset_s - kAsideS), at = with(best.offset_s),
               after = with(best.offset_s + kAsideS);
    if (!before || !at || !after) continue;
    const Eigen::Vector3d change = maps::log_so3(before->transpose() * *after) / (2.0 * kAsideS);
    Eigen::Vector3d off = maps::log_so3(turns[i].R_from_to.transpose() * *at);
    off *= std::min(1.0, kMostCountedRad / std::max(off.norm(), 1e-9));
    information += change.squaredNorm();
    pulls[i * kParts / turns.size()] += change.dot(off);
  }
  double squares = 0.0;
  for (const double pull : pulls) squares += pull * pull;
  const double alone = best.median_rad / kMedianLength * std::sqrt(information);
  return std::max(alone, std::sqrt(squares)) / std::max(information, 1e-12);
}

constexpr double kDegPerRad = 180.0 / std::numbers::pi;

bool tells_degrees(std::span<const ScanTurn> turns, const maps::Imu& imu) {
  std::vector<maps::ImuReading> scaled = *imu.readings;
  for (maps::ImuReading& reading : scaled) reading.rate_radps /= static_cast<float>(kDegPerRad);
  const auto check = fit_imu(turns, scaled);
  return check && check->explained >= kLeastExplained;
}

/// Where the axes of the readings come from.
std::string axes_of(const maps::Imu& imu) {
  return imu.source.starts_with('/')
             ? "the mount of the IMU in tf_static"
             : fmt::format("that the axes of {} are the lidar's", imu.source);
}

std::string fit_text(const maps::Imu& imu, const ImuCheck& check) {
  const Eigen::Vector3d bias = kDegPerRad * check.fit.bias_radps;
  return fmt::format(
      "{} is used: {:.0f} Hz, {:+.4f} s added to its stamps (sigma {:.4f} s), bias of its "
      "gyroscope {:.2f} {:.2f} {:.2f} deg/s, explains {:.0f} % of the turns of the scans, which "
      "differ by {:.3f} deg a scan",
      imu.source, imu.rate_hz(), 1e-9 * static_cast<double>(check.fit.clock_offset_ns),
      check.offset_sigma_s, bias.x(), bias.y(), bias.z(), 100.0 * check.explained,
      kDegPerRad * check.off_rad);
}

maps::Drive with_note(const maps::Drive& drive, std::string note) {
  maps::Drive::Contents contents = drive.contents();
  contents.notes.push_back(std::move(note));
  return maps::Drive(std::move(contents));
}

/// @param begin  scan of the first pose.
std::vector<ScanTurn> turns_of(const maps::Drive& drive, std::size_t begin,
                               const std::vector<OdometryPose>& poses) {
  std::vector<ScanTurn> turns;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    if (poses[i].status == OdometryStatus::kPredicted) continue;
    turns.push_back(
        {drive.stamp_ns(begin + i - 1), drive.stamp_ns(begin + i),
         poses[i - 1].T_odom_lidar.linear().transpose() * poses[i].T_odom_lidar.linear()});
  }
  return turns;
}

struct FitWithFault {
  std::optional<ImuCheck> check;
  /// As `imu_fault`.
  std::string fault;
};

/// First scan of those that the IMU is fitted to.
std::size_t first_to_fit(const maps::Drive& drive, const maps::Imu& imu) {
  std::vector<Eigen::Vector3d> rates(drive.size(), Eigen::Vector3d::Zero());
  for (std::size_t i = 1; i < drive.size(); ++i) {
    const double step_s = 1e-9 * static_cast<double>(drive.stamp_ns(i) - drive.stamp_ns(i - 1));
    const auto R =
        maps::turn_between_stamps(*imu.readings, {}, drive.stamp_ns(i - 1), drive.stamp_ns(i));
    if (R && step_s > 0.0) rates[i] = maps::log_so3(*R) / step_s;
  }
  const Eigen::Vector3d bias = median_vector(rates);
  std::vector<double> turned;
  for (std::size_t begin = 0; begin == 0 || begin + kFitScans <= drive.size();
       begin += kWindowStep) {
    turned.push_back(0.0);
    for (std::size_t i = begin + 1; i < std::min(begin + kFitScans, drive.size()); ++i)
      turned.back() += (rates[i] - bias).norm();
  }
  const double most = *std::ranges::max_element(turned);
  const auto first = std::ranges::find_if(turned, [&](double sum) { return sum >= 0.5 * most; });
  return kWindowStep * static_cast<std::size_t>(first - turned.begin());
}

}  // namespace

std::optional<ImuCheck> fit_imu(std::span<const ScanTurn> turns,
                                std::span<const maps::ImuReading> readings) {
  TriedOffset best = best_around(turns, readings, 0.0, kMostClockOffsetS, kCoarseOffsetStepS);
  if (best.turns < kLeastImuTurns) return std::nullopt;
  ImuCheck check;
  check.offset_is_inside = std::abs(best.offset_s) < kMostClockOffsetS - 0.5 * kCoarseOffsetStepS;
  best = best_around(turns, readings, best.offset_s, kCoarseOffsetStepS, kFineOffsetStepS);
  check.fit = {ns_of(best.offset_s), best.bias};
  check.offset_sigma_s = offset_sigma_s(turns, readings, best);
  check.off_rad = best.median_rad;
  const double without_rad2 = of_dead_gyroscope(turns, readings, best.offset_s).square_rad2;
  check.turn_rad = std::sqrt(without_rad2);
  check.explained = 1.0 - best.square_rad2 / std::max(without_rad2, 1e-12);
  return check;
}

std::string imu_fault(const maps::Imu& imu, std::span<const ScanTurn> turns,
                      const std::optional<ImuCheck>& check) {
  if (turns.size() < kLeastImuTurns)
    return fmt::format("odometry followed fewer than {} scans in a row", kLeastImuTurns + 1);
  if (!check) return "it has no readings at the stamps of the scans, or fewer than 20 a second";
  if (check->turn_rad < kTurningRad)
    return "the drive does not turn, so nothing tells whether it fits: record turns";
  if (check->explained < kLeastExplained && tells_degrees(turns, imu))
    return "its rates are in deg/s, expected rad/s: convert them";
  if (!check->offset_is_inside)
    return fmt::format(
        "its clock and that of the scans differ by more than {:g} s: correct its stamps, or check "
        "{}",
        kMostClockOffsetS, axes_of(imu));
  if (check->explained < kLeastExplained)
    return fmt::format(
        "it explains {:.0f} % of the turns of the scans, expected {:.0f} % (they differ by {:.2f} "
        "deg a scan): record turns, or check {}",
        100.0 * std::max(0.0, check->explained), 100.0 * kLeastExplained,
        kDegPerRad * check->off_rad, axes_of(imu));
  if (check->offset_sigma_s > kMostOffsetSigmaS)
    return fmt::format(
        "the drive turns too little to measure its clock offset (sigma {:.0f} ms): record turns",
        1e3 * check->offset_sigma_s);
  if (check->fit.bias_radps.norm() > kMostBiasRadps)
    return fmt::format("its gyroscope is off by {:.1f} deg/s at rest: check its unit and {}",
                       kDegPerRad * check->fit.bias_radps.norm(), axes_of(imu));
  return {};
}

maps::Drive with_fitted_imu(const maps::Drive& drive, int threads, const ProgressCallback& progress,
                            const CancelFlag& cancel) {
  const std::shared_ptr<const maps::Imu>& imu = drive.contents().imu;
  if (!imu || imu->fit) return drive;
  const std::size_t begin = first_to_fit(drive, *imu);
  const std::size_t end = std::min(begin + kFitScans, drive.size());
  const auto with_fit = [&](const maps::Imu::Fit& fit) {
    auto fitted = std::make_shared<maps::Imu>(*imu);
    fitted->fit = fit;
    return drive.with_imu(std::move(fitted));
  };
  const auto look = [&](const maps::Drive& fitted) {
    const std::vector<ScanTurn> turns = turns_of(
        drive, begin,
        run_odometry({.drive = fitted, .begin = begin, .end = end}, threads, progress, cancel));
    FitWithFault found;
    found.check = fit_imu(turns, *imu->readings);
    found.fault = imu_fault(*imu, turns, found.check);
    return found;
  };
  FitWithFault found = look(drive.with_imu(nullptr));
  if (!found.fault.empty()) {
    // Odometry may have lost its way without the IMU: the IMU may lead it, with what the fit tells
    // if that explains the turns, else as it is.
    const bool explains = found.check && found.check->explained >= kLeastExplained;
    FitWithFault led = look(with_fit(explains ? found.check->fit : maps::Imu::Fit{}));
    if (led.fault.empty()) found = std::move(led);
  }
  // With the first fit sweeps are straight, which tells the second one more exactly.
  if (found.fault.empty()) found = look(with_fit(found.check->fit));
  if (!found.fault.empty())
    return with_note(drive.with_imu(nullptr), imu->source + " is not used: " + found.fault);
  return with_note(with_fit(found.check->fit), fit_text(*imu, *found.check));
}

}  // namespace stillmap::mapping
