#include "sensing/sensor.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "geometry/random.hpp"
#include "sensing/rosette_sensor.hpp"
#include "sensing/sensor_file.hpp"
#include "sensing/spinning_sensor.hpp"

namespace stillmap::simulation {
namespace {

/// Data sheets give the range for a sheet of 80 %; the light that comes back falls with the square
/// of the range, hence the white sheet's.
double half_range_of(double range_at_80_percent_m) {
  return range_at_80_percent_m / std::sqrt(0.8);
}

/// Real calibrations differ from the nominal table by some hundredths of a degree; the same
/// deviations in every simulated sensor, so that a sweep depends on nothing but its name.
double calibration_deviation_rad(std::size_t laser) {
  constexpr std::uint64_t kKey = 64;
  constexpr double kLargestDeg = 0.05;
  return Random(key_of({kKey, laser})).uniform(-kLargestDeg, kLargestDeg) * kRadPerDeg;
}

/// Velodyne's calibration of an HDL-64E S2.1 (64e_s2.1-sztaki.yaml of the ROS driver), sorted by
/// elevation: in both blocks a saw of six lasers from +8 to -8 degrees, 3.2 apart.
double hdl64_azimuth_offset_rad(std::size_t laser) {
  constexpr std::size_t kTeeth = 6;
  constexpr double kStepDeg = 3.2;
  return (8.0 - kStepDeg * static_cast<double>((laser + 2) % kTeeth)) * kRadPerDeg;
}

/// Velodyne HDL-64E S2 manual: upper block +2 to -8.33 deg by 1/3, lower block -8.83 to -24.33 deg
/// by 1/2; 20,833 firings of all lasers a second; under 2 cm (1 sigma); 2 mrad; steps of 2 mm;
/// azimuths in steps of 0.09 deg; 0.9 m is the shortest range its ROS driver accepts.
/// As it was used for KITTI: a turn takes 0.1036 s, and nothing beyond 80 m is stored (of 120 m
/// that the manual gives for cars and leaves).
SpinningSpec hdl64() {
  SpinningSpec spec;
  spec.properties.name = "hdl64";
  spec.properties.period_s = 0.1036;
  spec.properties.max_range_m = 80.0;
  spec.properties.ring_bias_m = 0.025;
  spec.properties.half_range_m = half_range_of(120.0);
  spec.columns = 2158;
  spec.encoder_step_rad = 0.09 * kRadPerDeg;
  constexpr std::size_t kBlock = 32;
  for (std::size_t i = 0; i < 2 * kBlock; ++i) {
    const double nominal_deg = i < kBlock ? 2.0 - static_cast<double>(i) / 3.0
                                          : -8.83 - static_cast<double>(i - kBlock) / 2.0;
    // Lenses stand 2.6 cm to either side; the upper block's lie some 5 cm over the lower one's.
    spec.lasers.push_back({.elevation_rad = nominal_deg * kRadPerDeg + calibration_deviation_rad(i),
                           .azimuth_offset_rad = hdl64_azimuth_offset_rad(i % kBlock),
                           .left_m = i % 2 == 0 ? 0.026 : -0.026,
                           .up_m = i < kBlock ? 0.025 : -0.025});
  }
  return spec;
}

/// What both Ouster OS1 share: 1024 columns, lasers of a column fire at once, in four rows of
/// lasers that look to different sides (as the driver's beam_azimuth_angles say), 0.18 degrees of
/// divergence (data sheet), ranges in steps of 3 mm.
SpinningSpec os1(std::size_t lasers, double view_deg, double side_deg) {
  SpinningSpec spec;
  spec.columns = 1024;
  spec.properties.half_range_m = half_range_of(120.0);
  spec.properties.divergence_rad = 0.18 * kRadPerDeg;
  spec.properties.range_step_m = 0.003;
  for (std::size_t i = 0; i < lasers; ++i) {
    const double from_top = static_cast<double>(i) / static_cast<double>(lasers - 1);
    const double row = 1.0 - 2.0 / 3.0 * static_cast<double>(i % 4);
    spec.lasers.push_back({.elevation_rad = (0.5 - from_top) * view_deg * kRadPerDeg,
                           .azimuth_offset_rad = side_deg * row * kRadPerDeg});
  }
  return spec;
}

/// Ouster OS1-64, first generation data sheet: 33.2 deg of view, 0.8 to 120 m (80 % reflectivity),
/// 1.2 to 5 cm; the rows look 3.164 and 1.055 deg to either side.
SpinningSpec os1_64() {
  SpinningSpec spec = os1(64, 33.2, 3.164);
  spec.properties.name = "os1-64";
  spec.properties.min_range_m = 0.8;
  spec.properties.max_range_m = 120.0;
  spec.properties.range_noise_m = 0.02;
  return spec;
}

/// Ouster OS1-128, second generation data sheet: 45 deg of view, 0.3 to 120 m (80 % reflectivity),
/// 0.7 to 5 cm; the rows look 4.23 and 1.41 deg to either side.
SpinningSpec os1_128() {
  SpinningSpec spec = os1(128, 45.0, 4.23);
  spec.properties.name = "os1-128";
  spec.properties.min_range_m = 0.3;
  spec.properties.max_range_m = 120.0;
  spec.properties.range_noise_m = 0.015;
  return spec;
}

/// Velodyne VLP-16 manual: +-15 deg by 2, 100 m, 3 cm at most, 3 mrad, steps of 2 mm, one laser
/// every 2.304 us and a sequence of all every 55.296 us, in the order -15, 1, -13, 3 ... -1, 15
/// deg; 0.4 m is the shortest range its ROS driver accepts. 1808 sequences are a turn at 10 Hz.
SpinningSpec vlp16() {
  SpinningSpec spec;
  spec.properties.name = "vlp16";
  spec.properties.min_range_m = 0.4;
  spec.properties.max_range_m = 100.0;
  spec.properties.half_range_m = half_range_of(100.0);
  spec.properties.range_noise_m = 0.015;
  spec.properties.divergence_rad = 0.003;
  spec.columns = 1808;
  for (int i = 0; i < 16; ++i) {
    const double elevation_deg = i % 2 == 0 ? -15.0 + i : i;
    spec.lasers.push_back(
        {.elevation_rad = elevation_deg * kRadPerDeg, .time_offset_s = 2.304e-6 * i});
  }
  return spec;
}

using MakeSensor = std::unique_ptr<Sensor> (*)();
constexpr std::array<std::pair<std::string_view, MakeSensor>, 5> kSensors{{
    {"hdl64", [] { return make_spinning_sensor(hdl64()); }},
    {"os1-64", [] { return make_spinning_sensor(os1_64()); }},
    {"os1-128", [] { return make_spinning_sensor(os1_128()); }},
    {"vlp16", [] { return make_spinning_sensor(vlp16()); }},
    {"avia", make_avia},
}};

}  // namespace

std::unique_ptr<Sensor> make_sensor(const std::string& name_or_file) {
  for (const auto& [name, make] : kSensors) {
    if (name == name_or_file) return make();
  }
  std::error_code error;
  if (!std::filesystem::exists(name_or_file, error)) {
    throw std::invalid_argument(fmt::format("sensor: found \"{}\", expected one of {}, or a file",
                                            name_or_file, sensor_names()));
  }
  return make_spinning_sensor(read_sensor_file(name_or_file));
}

std::string sensor_names() {
  std::string names;
  for (const auto& [name, make] : kSensors) {
    if (!names.empty()) names += ' ';
    names += name;
  }
  return names;
}

}  // namespace stillmap::simulation
