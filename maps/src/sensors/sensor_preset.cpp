#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/median.hpp>
#include <stillmap/maps/scan_file.hpp>
#include <stillmap/maps/sensor_preset.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>

#include "drives/address.hpp"
#include "drives/layout.hpp"
#include "sensors/turn_times.hpp"

namespace stillmap::maps {
namespace {

constexpr std::optional<double> kStart = 0.0;
constexpr std::optional<double> kEnd = 1.0;
constexpr std::nullopt_t kNone = std::nullopt;

/// Angles by the makers' data sheets. Stamps by their ROS drivers: velodyne_driver takes the last
/// packet's unless `timestamp_first_packet`, rslidar_sdk the last point's unless
/// `ts_first_point`, ouster-ros the first column's, HesaiLidar_ROS_2.0 the first point's. Ranges:
/// OS0 sees dark things (10 %) to 35 m, Mid-360 to 40 m; who carries an Avia or a Mid-360 stands
/// within 1 m and 0.5 m.
constexpr std::array<SensorPreset, 21> kPresets{{
    {"hdl-64e", -24.9, 2.0, 64, kEnd, kNone, kNone},
    {"hdl-32e", -30.67, 10.67, 32, kEnd, kNone, kNone},
    {"vlp-16", -15.0, 15.0, 16, kEnd, kNone, kNone},
    {"vlp-32c", -25.0, 15.0, 32, kEnd, kNone, kNone},
    {"os0-32", -45.0, 45.0, 32, kStart, kNone, 50.0},
    {"os0-64", -45.0, 45.0, 64, kStart, kNone, 50.0},
    {"os0-128", -45.0, 45.0, 128, kStart, kNone, 50.0},
    {"os1-32", -22.5, 22.5, 32, kStart, kNone, kNone},
    {"os1-64", -22.5, 22.5, 64, kStart, kNone, kNone},
    {"os1-128", -22.5, 22.5, 128, kStart, kNone, kNone},
    {"os2-32", -11.25, 11.25, 32, kStart, kNone, kNone},
    {"os2-64", -11.25, 11.25, 64, kStart, kNone, kNone},
    {"os2-128", -11.25, 11.25, 128, kStart, kNone, kNone},
    {"pandar64", -25.0, 15.0, 64, kStart, kNone, kNone},
    {"xt32", -16.0, 15.0, 32, kStart, kNone, kNone},
    {"rs-16", -15.0, 15.0, 16, kEnd, kNone, kNone},
    {"rs-32", -25.0, 15.0, 32, kEnd, kNone, kNone},
    {"rs-128", -25.0, 15.0, 128, kEnd, kNone, kNone},
    {"avia", -38.6, 38.6, 6, kNone, 1.0, kNone},
    {"hap", -12.5, 12.5, 6, kNone, kNone, kNone},
    {"mid-360", -7.0, 52.0, 4, kNone, 0.5, 40.0},
}};

/// Angles of what is far enough away that where in the sensor a beam starts does not matter.
struct Spans {
  double lowest_deg = 0.0;
  double highest_deg = 0.0;
  /// Degrees of azimuth that have points.
  int azimuths = 0;
};

std::optional<Spans> spans_of(const PointCloud& cloud) {
  constexpr float kNearM = 3.0F;
  constexpr std::size_t kLeast = 500;
  constexpr float kDegPerRad = 180.0F / std::numbers::pi_v<float>;
  std::vector<float> elevations;
  std::array<bool, 360> azimuths{};
  for (const Eigen::Vector3f& p : cloud.positions) {
    if (p.norm() < kNearM) continue;
    elevations.push_back(std::atan2(p.z(), p.head<2>().norm()) * kDegPerRad);
    const float azimuth = std::atan2(p.y(), p.x()) * kDegPerRad + 180.0F;
    azimuths[std::min<std::size_t>(static_cast<std::size_t>(azimuth), 359)] = true;
  }
  if (elevations.size() < kLeast) return std::nullopt;
  const auto at_share = [&](double share) {
    const auto place = elevations.begin() +
                       static_cast<std::ptrdiff_t>(share * static_cast<double>(elevations.size()));
    std::nth_element(elevations.begin(), place, elevations.end());
    return static_cast<double>(*place);
  };
  // Some beams of a real scan are off.
  Spans spans;
  spans.lowest_deg = at_share(0.003);
  spans.highest_deg = at_share(0.997);
  spans.azimuths = static_cast<int>(std::count(azimuths.begin(), azimuths.end(), true));
  return spans;
}

bool fits(const SensorPreset& sensor, const Spans& spans, std::size_t points) {
  // A vehicle hides the lowest beams here and there, the sky many of the highest.
  constexpr double kAboveLowestDeg = 3.0, kBeyondDeg = 1.5, kBelowHighestDeg = 10.0;
  const bool turns = sensor.stamp_at.has_value();
  const bool all_around = spans.azimuths > 270;
  const double height_deg = spans.highest_deg - spans.lowest_deg;
  if (sensor.name == "avia")
    return spans.azimuths <= 90 && height_deg <= 80.0 && height_deg >= 20.0;
  if (sensor.name == "hap")
    return spans.azimuths > 90 && spans.azimuths <= 125 && height_deg <= 26.5 && height_deg >= 15.0;
  if (!all_around) return false;
  if (spans.lowest_deg < sensor.lowest_deg - kBeyondDeg ||
      spans.lowest_deg > sensor.lowest_deg + kAboveLowestDeg ||
      spans.highest_deg > sensor.highest_deg + kBeyondDeg ||
      spans.highest_deg < sensor.highest_deg - kBelowHighestDeg)
    return false;
  // Turns have 512 to 2,300 columns; a third of the shots and more come back.
  return !turns || (points >= sensor.lasers * 170 && points <= sensor.lasers * 2300);
}

/// Usual time between scans, where it may be a turn.
double period_s(const Drive& drive) {
  constexpr double kUsualS = 0.1, kLeastS = 0.03, kMostS = 0.25;
  std::vector<std::int64_t> periods;
  for (std::size_t i = 1; i < drive.size(); ++i)
    periods.push_back(drive.stamp_ns(i) - drive.stamp_ns(i - 1));
  if (periods.empty()) return kUsualS;
  const double median_s = 1e-9 * static_cast<double>(median(std::move(periods)));
  return median_s >= kLeastS && median_s <= kMostS ? median_s : kUsualS;
}

}  // namespace

std::span<const SensorPreset> sensor_presets() { return kPresets; }

const SensorPreset& sensor_preset(std::string_view name) {
  std::string known;
  for (const SensorPreset& sensor : kPresets) {
    if (sensor.name == name) return sensor;
    known += (known.empty() ? "" : " ") + std::string(sensor.name);
  }
  throw InputError("sensor", "'" + std::string(name) + "'", "one of " + known);
}

std::vector<std::string> guess_sensors(const Scan& scan) {
  std::vector<std::string> names;
  const std::optional<Spans> spans = spans_of(scan.cloud);
  for (const SensorPreset& sensor : kPresets)
    if (spans && fits(sensor, *spans, scan.cloud.size())) names.emplace_back(sensor.name);
  return names;
}

Drive with_sensor(const Drive& drive, const SensorPreset& sensor) {
  Drive::Contents contents = drive.contents();
  const bool at_one_instant =
      contents.points_from_map || contents.layout == DriveLayout::kKittiOdometry ||
      contents.layout == DriveLayout::kKeyframes || contents.layout == DriveLayout::kHdlGraphSlam;
  if (!sensor.stamp_at || at_one_instant || !contents.spin_start_end_s.empty()) return drive;
  set_entries_of_files(contents);
  Drive::Contents::Entries& entries = contents.entries;
  // Scans that are read otherwise are called otherwise: what was found in them is not taken over.
  entries.topic += (entries.topic.empty() ? "" : " ") + std::string(sensor.name);
  entries.read = [read = entries.read, turn_s = period_s(drive),
                  stamp_at = *sensor.stamp_at](std::size_t number) {
    DecodedScan scan = read(number);
    if (scan.cloud.time_offsets_s.empty()) set_turn_times(scan.cloud, turn_s, stamp_at);
    return scan;
  };
  return Drive(std::move(contents));
}

const SensorPreset* sensor_in_words(const std::filesystem::path& root) {
  const Address address = address_of(root);
  return address.sensor.empty() ? nullptr : &sensor_preset(address.sensor);
}

}  // namespace stillmap::maps
