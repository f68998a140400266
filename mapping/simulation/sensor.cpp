#include "sensor.hpp"

#include <numbers>

namespace stillmap::simulation {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

void add_beams(Sensor& sensor, double top_deg, double step_deg, int count) {
  for (int i = 0; i < count; ++i) {
    sensor.elevations_rad.push_back((top_deg - step_deg * i) * kRadPerDeg);
  }
}

/// Velodyne HDL-64E S2 manual: upper block +2 to -8.33 deg by 1/3, lower block -8.83 to -24.33 deg
/// by 1/2.
Sensor hdl64() {
  Sensor sensor;
  add_beams(sensor, 2.0, 1.0 / 3.0, 32);
  add_beams(sensor, -8.83, 0.5, 32);
  sensor.columns = 2083;
  return sensor;
}

/// Ouster OS1-64, first generation data sheet: 33.2 deg of view, evenly, 1024 columns.
Sensor os1_64() {
  Sensor sensor;
  add_beams(sensor, 16.6, 33.2 / 63.0, 64);
  sensor.columns = 1024;
  return sensor;
}

/// Velodyne VLP-16 manual: +-15 deg by 2, 0.2 deg of azimuth at 10 turns a second, 100 m.
Sensor vlp16() {
  Sensor sensor;
  add_beams(sensor, 15.0, 2.0, 16);
  sensor.columns = 1800;
  sensor.max_range_m = 100.0;
  return sensor;
}

}  // namespace

std::optional<Sensor> sensor_named(std::string_view name) {
  if (name == "hdl64") return hdl64();
  if (name == "os1-64") return os1_64();
  if (name == "vlp16") return vlp16();
  return std::nullopt;
}

std::string sensor_names() { return "hdl64 os1-64 vlp16"; }

}  // namespace stillmap::simulation
