#include <fmt/format.h>
#include <stillmap/maps/drive_check.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "checks/duplicate_scans.hpp"
#include "checks/viewpoint_check.hpp"
#include "drives/drive_sample.hpp"
#include "drives/layout.hpp"
#include "formats/point_table.hpp"

namespace stillmap::maps {
namespace {

constexpr double kGapOfMedian = 2.5;
/// A folder whose scans were picked (key frames) has no period; a recording's are all there.
constexpr double kMostGapShare = 0.05;
constexpr double kFastestMps = 120.0;
constexpr double kMostTiltRad = 2.0 * std::numbers::pi / 180.0;
constexpr double kMostSlopeRad = 20.0 * std::numbers::pi / 180.0;
constexpr double kCoarseStepM = 0.05;
constexpr double kMillimetresFromM = 400.0;

double degrees(double rad) { return rad * 180.0 / std::numbers::pi; }

void check_periods(const Drive& drive, DriveCheck& check) {
  if (drive.size() < 3) return;
  std::vector<double> periods_s;
  for (std::size_t i = 1; i < drive.size(); ++i)
    periods_s.push_back(1e-9 * static_cast<double>(drive.stamp_ns(i) - drive.stamp_ns(i - 1)));
  ScanPeriods periods{.median_s = median(periods_s)};
  for (std::size_t i = 0; i < periods_s.size(); ++i) {
    if (periods_s[i] > kGapOfMedian * periods.median_s) ++periods.gaps;
    if (periods_s[i] <= periods.longest_s) continue;
    periods.longest_s = periods_s[i];
    periods.longest_after = i;
  }
  check.periods = periods;
  const double share = static_cast<double>(periods.gaps) / static_cast<double>(periods_s.size());
  if (periods.gaps == 0 || (share > kMostGapShare && !is_recording(drive.contents().layout)))
    return;
  check.findings.push_back(
      {"gaps",
       fmt::format(
           "{} gaps between scans, the longest of {:.2f} s after scan {} where {:.2f} s are "
           "usual",
           periods.gaps, periods.longest_s, periods.longest_after, periods.median_s),
       "record without losses, or give the parts with --select or as drives of their own: odometry "
       "may lose its way there"});
}

void check_path(const Drive& drive, DriveCheck& check) {
  if (!drive.has_poses() || drive.size() < 2) return;
  double length_m = 0.0;
  std::size_t jumps = 0, first_jump = 0;
  for (std::size_t i = 1; i < drive.size(); ++i) {
    const double step_m =
        (drive.T_map_lidar(i).translation() - drive.T_map_lidar(i - 1).translation()).norm();
    const double period_s = 1e-9 * static_cast<double>(drive.stamp_ns(i) - drive.stamp_ns(i - 1));
    length_m += step_m;
    if (step_m > 5.0 && step_m > kFastestMps * period_s && jumps++ == 0) first_jump = i;
  }
  if (length_m == 0.0)
    check.findings.push_back({"poses_stand_still", "all poses are at one place",
                              "leave them out with --odometry default, or give the right ones with "
                              "--poses"});
  if (jumps > 0)
    check.findings.push_back(
        {"poses_jump",
         fmt::format("{} steps between poses of more than {} m/s, the first to scan {}", jumps,
                     kFastestMps, first_jump),
         "look for lost fixes, or for poses of other scans; --odometry default makes poses of the "
         "scans, with --gnss-sigma held by these"});
}

/// Steps of the positions as they were written.
void check_digits(const Drive& drive, std::vector<DriveFinding>& findings) {
  if (!drive.has_poses()) return;
  const Eigen::Vector3d& steps_m = drive.contents().position_step_m;
  Eigen::Index axis = 0;
  const double step_m = steps_m.maxCoeff(&axis);
  if (step_m < kCoarseStepM) return;
  constexpr std::array kAxes{"x", "y", "z"};
  findings.push_back(
      {"coarse_positions",
       fmt::format("positions of the poses lie on steps of {:.3g} m along {}: they were written "
                   "with too few digits, or as 32-bit floats",
                   step_m, kAxes[static_cast<std::size_t>(axis)]),
       fmt::format("write them with millimetres (as doubles, or from an origin nearby); else build "
                   "with --odometry default --gnss-sigma {:.2g}",
                   0.3 * step_m)});
}

void check_readings(const DriveCheck& check, std::vector<DriveFinding>& findings) {
  if (!check.overlap) return;
  const PoseOverlap& overlap = *check.overlap;
  const auto add = [&](const std::string& reading, double share, const std::string& remedy) {
    findings.push_back({"frame_of_poses",
                        fmt::format("scans that lie apart overlap by {:.0f} % with the poses as "
                                    "they are, and by {:.0f} % {}",
                                    100.0 * overlap.given, 100.0 * share, reading),
                        remedy});
  };
  if (is_better(overlap.other, overlap) && overlap.other >= overlap.without) {
    const bool is_inverse = overlap.other_reading.starts_with("the inverses of poses");
    const bool is_of_other_axes = overlap.other_reading.find("a frame") != std::string::npos;
    std::string remedy = "give poses T_map_lidar, from the lidar frame to the map frame: ";
    if (is_inverse) remedy += "replace each pose by its inverse";
    if (is_inverse && is_of_other_axes) remedy += ", then ";
    if (is_of_other_axes)
      remedy += "multiply each pose from the right by the lidar's place in the frame of the poses";
    return add("if they are read as " + overlap.other_reading, overlap.other, remedy);
  }
  if (is_better(overlap.without, overlap))
    add("without any", overlap.without,
        "the poses belong to other scans or another time: check their order and stamps, or leave "
        "them out with --odometry default; or the points lie in the frame of the poses already, as "
        "those of registered scans: 'DRIVE?points=map' reads them so");
}

void check_mounting(const std::vector<SampledScan>& samples, DriveCheck& check) {
  std::vector<double> x, y, z, heights_m;
  for (const SampledScan& sample : samples) {
    if (!sample.ground) continue;
    x.push_back(sample.ground->up.x());
    y.push_back(sample.ground->up.y());
    z.push_back(sample.ground->up.z());
    heights_m.push_back(sample.ground->height_m);
  }
  if (2 * x.size() <= samples.size() || x.empty()) return;
  const Eigen::Vector3d up = Eigen::Vector3d(median(x), median(y), median(z)).normalized();
  SensorMounting mounting;
  mounting.R_level_lidar = turn_between(up, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  mounting.height_m = median(heights_m);
  mounting.tilt_rad = std::acos(std::clamp(up.z(), -1.0, 1.0));
  mounting.scans = x.size();
  check.mounting = mounting;
  if (mounting.tilt_rad <= kMostTiltRad) return;
  const Eigen::Vector3d turn_rad = roll_pitch_yaw_rad(mounting.R_level_lidar);
  const bool upside_down = up.z() < 0.0;
  check.findings.push_back(
      {upside_down ? "sensor_upside_down" : "sensor_tilted",
       fmt::format(
           "the sensor {} against the ground: roll {:.1f}, pitch {:.1f} deg, {:.2f} m above "
           "it, by {} scans",
           upside_down ? "hangs upside down"
                       : fmt::format("is tilted by {:.1f} deg", degrees(mounting.tilt_rad)),
           degrees(turn_rad.x()), degrees(turn_rad.y()), mounting.height_m, mounting.scans),
       "turn the points by these angles before, so that z is up; nothing needs to be done where "
       "poses hold the tilt, as a calibration to the vehicle does, or come from odometry: a build "
       "turns scans upright by them"});
}

/// The map's z against the ground's, over scans with poses.
void check_level(const Drive& drive, const std::vector<SampledScan>& samples, DriveCheck& check) {
  if (!drive.has_poses()) return;
  std::vector<double> angles_rad;
  for (const SampledScan& sample : samples) {
    if (!sample.ground) continue;
    const Eigen::Vector3d up = drive.T_map_lidar(sample.index).linear() * sample.ground->up;
    angles_rad.push_back(std::acos(std::clamp(up.z(), -1.0, 1.0)));
  }
  if (2 * angles_rad.size() <= samples.size() || angles_rad.empty()) return;
  const double angle_rad = median(angles_rad);
  if (angle_rad <= kMostSlopeRad) return;
  check.findings.push_back(
      {"map_not_level",
       fmt::format("with these poses the ground of the map is {:.0f} deg off the horizontal",
                   degrees(angle_rad)),
       "give poses in a frame whose z is up: those of a camera's frame (z ahead) must be turned, "
       "as "
       "KITTI's calib.txt does beside poses.txt"});
}

void check_values(const std::vector<SampledScan>& samples, DriveCheck& check) {
  std::vector<double> ranges_m;
  std::size_t points = 0, points_in_file = 0;
  for (const SampledScan& sample : samples) {
    if (sample.points > 0) ranges_m.push_back(sample.median_range_m);
    points += sample.points;
    points_in_file += sample.points_in_file;
    if (!sample.intensities) continue;
    const auto [low, high] = *sample.intensities;
    if (!check.intensities) check.intensities = sample.intensities;
    check.intensities = {std::min((*check.intensities)[0], low),
                         std::max((*check.intensities)[1], high)};
  }
  if (check.intensities && (*check.intensities)[0] == (*check.intensities)[1])
    check.findings.push_back({"intensity_constant",
                              fmt::format("all intensities are {}", (*check.intensities)[0]),
                              "map their field to `intensity`, if the sensor has them: colours and "
                              "some detectors need them"});
  if (!ranges_m.empty() && median(ranges_m) > kMillimetresFromM)
    check.findings.push_back(
        {"millimetres",
         fmt::format("half of the points are farther than {:.0f} m from the sensor",
                     median(ranges_m)),
         "give coordinates in metres in the sensor's frame: these look like millimetres, or like "
         "points that are in the map's frame already"});
  if (points_in_file > 0 && 2 * points < points_in_file)
    check.findings.push_back(
        {"few_returns",
         fmt::format("{} of {} points are no returns, not finite or marked unsure by the sensor",
                     points_in_file - points, points_in_file),
         "usual for organized clouds of a sensor under the open sky; otherwise "
         "check the fields x, y, z"});
}

/// Times of points that were left out, or were read as what they may not be.
void check_point_times(const Drive& drive, const std::vector<SampledScan>& samples,
                       std::vector<DriveFinding>& findings) {
  const auto taken = std::ranges::count_if(samples, &SampledScan::has_times);
  const bool is_left_out = 2 * static_cast<std::size_t>(taken) <= samples.size();
  const auto noted = std::ranges::find_if(
      samples, [](const SampledScan& sample) { return !sample.times_note.empty(); });
  std::vector<std::string> times;
  std::size_t known = 0;
  for (const std::string& field : drive.contents().entries.fields) {
    const std::string name = field.substr(0, field.find(' '));
    if (may_be_time_name(name)) times.push_back(field);
    if (is_time_name(name)) ++known;
  }
  std::string what;
  if (noted != samples.end())
    what = noted->times_note;
  else if (is_left_out && known > 1)
    what = fmt::format("several fields may be the times of the points ({}): none is taken",
                       fmt::join(times, ", "));
  else if (is_left_out && known == 0 && !times.empty())
    what = fmt::format(
        "no field has a name that is known for the times of the points ({}): none "
        "is taken",
        fmt::join(times, ", "));
  if (what.empty()) return;
  if (!is_left_out) {
    findings.push_back({"times_doubted", what,
                        "if this is wrong, let the driver write seconds as float64, or nanoseconds "
                        "as uint32, from the scan's stamp"});
    return;
  }
  findings.push_back(
      {"times_not_taken", what,
       "let the driver write one, by the clock of the stamps: without, a scan that moved while it "
       "was taken stays bent. 'DRIVE?sensor=NAME' takes the times of a sensor's turn, where points "
       "lie in the order in which they were taken"});
}

}  // namespace

DriveCheck check_drive(const Drive& drive) {
  DriveCheck check;
  check_periods(drive, check);
  check_path(drive, check);
  check_digits(drive, check.findings);
  if (auto finding = check_viewpoints(drive)) check.findings.push_back(*std::move(finding));
  if (const auto duplicates = duplicate_scans(drive); duplicates.count > 0)
    check.findings.push_back(
        {"duplicates",
         fmt::format(
             "{} scans are equal to the one before, the first is scan {}{}", duplicates.count,
             duplicates.first,
             duplicates.looked_at + 1 == drive.size()
                 ? ""
                 : fmt::format(" ({} of {} were looked at)", duplicates.looked_at, drive.size())),
         "leave them out: they count as seen twice"});
  std::vector<SampledScan> samples;
  std::vector<std::array<PosedScan, 2>> pairs;
  for (const SamplePair& pair : choose_samples(drive)) {
    samples.push_back(sample_scan(drive, pair.first));
    ++check.scans_read;
    if (!pair.second) continue;
    SampledScan second = sample_scan(drive, *pair.second);
    ++check.scans_read;
    pairs.push_back({PosedScan{drive.T_map_lidar(pair.first), samples.back().standing},
                     PosedScan{drive.T_map_lidar(*pair.second), std::move(second.standing)}});
  }
  check.overlap = compare_readings(pairs);
  check_readings(check, check.findings);
  check_mounting(samples, check);
  check_level(drive, samples, check);
  check_values(samples, check);
  check_point_times(drive, samples, check.findings);
  return check;
}

}  // namespace stillmap::maps
