#include "packets/velodyne_models.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

namespace stillmap::maps {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

/// Times by the manuals: VLP-16 63-9243 (9.3.1.3), HDL-32E 63-9113, VLP-32C 63-9325, VLS-128
/// 63-9483. HDL-64E's packets (63-HDL64ES3) hold six firings of two banks of 32; the times within a
/// firing of 48 us are left at its start.
constexpr std::array<VelodyneModel, 6> kModels{{
    {"VLP-16", 0.002, 16, 55.296, 2.304, 1, true},
    {"Puck Hi-Res", 0.002, 16, 55.296, 2.304, 1, true},
    {"HDL-32E", 0.002, 32, 46.08, 1.152, 1, true},
    {"VLP-32C", 0.004, 32, 55.296, 2.304, 2, true},
    {"VLS-128", 0.004, 128, 53.3, 2.665, 8, true},
    {"HDL-64E", 0.002, 64, 48.0, 0.0, 64, false},
}};

constexpr std::array kVlp32cElevationsDeg{
    -25.0,  -1.0,   -1.667, -15.639, -11.31, 0.0,    -0.667, -8.843, -7.254, 0.333,  -0.333,
    -6.148, -5.333, 1.333,  0.667,   -4.0,   -4.667, 1.667,  1.0,    -3.667, -3.333, 3.333,
    2.333,  -2.667, -3.0,   7.0,     4.667,  -2.333, -2.0,   15.0,   10.333, -1.333};
constexpr std::array kVlp32cAzimuthsDeg{
    -1.4, 4.2, -1.4, 1.4, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -4.2, 1.4,
    -1.4, 4.2, -1.4, 4.2, -4.2, 1.4, -1.4, 1.4, -1.4, 1.4, -1.4, 4.2, -4.2, 1.4, -1.4, 1.4};
constexpr std::array kVls128ElevationsDeg{
    -11.742, -1.99,   3.4,   -5.29,   -0.78, 4.61,  -4.08,   1.31,   -6.5,  -1.11,   4.28,  -4.41,
    0.1,     6.48,    -3.2,  2.19,    -3.86, 1.53,  -9.244,  -1.77,  2.74,  -5.95,   -0.56, 4.83,
    -2.98,   2.41,    -6.28, -0.89,   3.62,  -5.07, 0.32,    7.58,   -0.34, 5.18,    -3.64, 1.75,
    -25.0,   -2.43,   2.96,  -5.73,   0.54,  9.7,   -2.76,   2.63,   -7.65, -1.55,   3.84,  -4.85,
    3.18,    -5.51,   -0.12, 5.73,    -4.3,  1.09,  -16.042, -2.21,  4.06,  -4.63,   0.76,  15.0,
    -3.42,   1.97,    -6.85, -1.33,   -5.62, -0.23, 5.43,    -3.53,  0.98,  -19.582, -2.32, 3.07,
    -4.74,   0.65,    11.75, -2.65,   1.86,  -7.15, -1.44,   3.95,   -2.1,  3.29,    -5.4,  -0.01,
    4.5,     -4.19,   1.2,   -13.565, -1.22, 4.17,  -4.52,   0.87,   6.08,  -3.31,   2.08,  -6.65,
    1.42,    -10.346, -1.88, 3.51,    -6.06, -0.67, 4.72,    -3.97,  2.3,   -6.39,   -1.0,  4.39,
    -5.18,   0.21,    6.98,  -3.09,   4.98,  -3.75, 1.64,    -8.352, -2.54, 2.85,    -5.84, -0.45,
    8.43,    -2.87,   2.52,  -6.17,   -1.66, 3.73,  -4.96,   0.43};
constexpr std::array kVls128AzimuthsDeg{-6.354, -4.548, -2.732, -0.911, 0.911, 2.732, 4.548, 6.354};

/// Lowest first and in steps of two: even lasers from the bottom, odd ones from the middle.
std::vector<VelodyneLaser> interleaved(std::size_t lasers, double lowest_deg, double step_deg) {
  std::vector<VelodyneLaser> all(lasers);
  for (std::size_t i = 0; i < lasers; ++i) {
    const std::size_t place = i / 2 + (i % 2 == 0 ? 0 : lasers / 2);
    all[i].elevation_rad = (lowest_deg + step_deg * static_cast<double>(place)) * kRadPerDeg;
  }
  return all;
}

/// One `key: value` of a calibration, which is YAML in block or flow style.
struct Entry {
  std::size_t line = 0;
  bool starts_laser = false;
  std::string_view key;
  std::string_view value;
};

std::vector<Entry> entries_of(std::string_view text) {
  std::vector<Entry> entries;
  std::size_t line = 1;
  bool starts_laser = false;
  constexpr std::string_view kBetween = " \t\r\n{},";
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t begin = text.find_first_not_of(kBetween, at);
    line += static_cast<std::size_t>(
        std::count(text.begin() + static_cast<std::ptrdiff_t>(at),
                   text.begin() + static_cast<std::ptrdiff_t>(std::min(begin, text.size())), '\n'));
    if (begin == std::string_view::npos) break;
    const std::size_t end = std::min(text.find_first_of(kBetween, begin), text.size());
    const std::string_view word = text.substr(begin, end - begin);
    at = end;
    if (word == "-") {
      starts_laser = true;
    } else if (word.ends_with(':')) {
      entries.push_back({line, starts_laser, word.substr(0, word.size() - 1), {}});
      starts_laser = false;
    } else if (!entries.empty() && entries.back().value.empty()) {
      entries.back().value = word;
    }
  }
  return entries;
}

double* place_of(VelodyneLaser& laser, std::string_view key) {
  if (key == "vert_correction") return &laser.elevation_rad;
  if (key == "rot_correction") return &laser.azimuth_rad;
  if (key == "dist_correction") return &laser.range_m;
  if (key == "dist_correction_x") return &laser.near_x_m;
  if (key == "dist_correction_y") return &laser.near_y_m;
  if (key == "vert_offset_correction") return &laser.vertical_offset_m;
  return key == "horiz_offset_correction" ? &laser.horizontal_offset_m : nullptr;
}

}  // namespace

const VelodyneModel* velodyne_model(std::uint8_t factory_byte) {
  switch (factory_byte) {
    case 0x22:
      return &kModels[0];
    case 0x24:
      return &kModels[1];
    case 0x21:
      return &kModels[2];
    case 0x28:
      return &kModels[3];
    case 0x63:
    case 0xa1:
      return &kModels[4];
    default:
      return nullptr;
  }
}

const VelodyneModel& velodyne_hdl64e() { return kModels[5]; }

std::vector<VelodyneLaser> usual_lasers(const VelodyneModel& model) {
  if (model.name == "VLP-16") return interleaved(16, -15.0, 2.0);
  if (model.name == "Puck Hi-Res") return interleaved(16, -10.0, 4.0 / 3.0);
  if (model.name == "HDL-32E") return interleaved(32, -92.0 / 3.0, 4.0 / 3.0);
  std::vector<VelodyneLaser> lasers(model.has_usual_angles ? model.lasers : 0);
  for (std::size_t i = 0; i < lasers.size(); ++i) {
    const bool is_vls = model.lasers == kVls128ElevationsDeg.size();
    lasers[i].elevation_rad =
        (is_vls ? kVls128ElevationsDeg.at(i) : kVlp32cElevationsDeg.at(i)) * kRadPerDeg;
    lasers[i].azimuth_rad =
        (is_vls ? kVls128AzimuthsDeg.at(i % 8) : kVlp32cAzimuthsDeg.at(i)) * kRadPerDeg;
  }
  return lasers;
}

std::vector<VelodyneLaser> read_velodyne_calibration(const std::filesystem::path& file) {
  constexpr std::size_t kMostBytes = std::size_t{1} << 20U;
  constexpr std::size_t kMostLasers = 128;
  const std::string text = read_text(file, kMostBytes);
  std::vector<std::optional<VelodyneLaser>> by_id;
  VelodyneLaser laser;
  std::size_t id = kMostLasers;  // none yet
  const auto finish = [&] {
    if (id == kMostLasers) return;
    by_id.resize(std::max(by_id.size(), id + 1));
    by_id[id] = laser;
  };
  for (const Entry& entry : entries_of(text)) {
    if (entry.starts_laser) {
      finish();
      laser = {};
      id = kMostLasers;
    }
    const auto refuse = [&](const char* needed) {
      throw InputError(place(file, entry.line),
                       fmt::format("'{}: {}'", entry.key.substr(0, 64), entry.value.substr(0, 64)),
                       fmt::format("{}: make the file with velodyne_pointcloud's "
                                   "gen_calibration.py",
                                   needed));
    };
    if (entry.key == "laser_id") {
      const std::optional<std::uint64_t> number = parse_count(entry.value);
      if (!number || *number >= kMostLasers) refuse("a whole number below 128");
      id = static_cast<std::size_t>(*number);
    } else if (entry.key == "two_pt_correction_available") {
      laser.two_points = entry.value == "true";
    } else if (double* const value = place_of(laser, entry.key)) {
      const std::optional<double> number = parse_number(entry.value);
      if (!number || !(std::abs(*number) < 10.0)) refuse("a number below 10 (radians, metres)");
      *value = *number;
    }
  }
  finish();
  std::vector<VelodyneLaser> lasers;
  for (const auto& each : by_id) {
    if (!each)
      throw InputError(file.string(), fmt::format("no laser {}", lasers.size()),
                       "all lasers of the sensor: make the file again");
    lasers.push_back(*each);
  }
  if (lasers.empty())
    throw InputError(file.string(), "no laser_id",
                     "a calibration of velodyne_pointcloud, as its gen_calibration.py makes it");
  return lasers;
}

}  // namespace stillmap::maps
