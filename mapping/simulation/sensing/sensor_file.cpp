#include "sensing/sensor_file.hpp"

#include "sensing/sensor.hpp"

#include <stillmap/maps/json_fields.hpp>
#include <stillmap/maps/text.hpp>

#include <cstdint>
#include <string>

namespace stillmap::simulation {
namespace {

// The largest sensors on sale have 128 lasers and 4096 columns.
constexpr std::size_t kMaxBeams = 256;
constexpr std::int64_t kMaxColumns = 8192;
constexpr std::uintmax_t kMaxBytes = 1 << 20;

using maps::JsonField;

double number_or(const JsonField& object, const char* key, double low, double high, double absent) {
  return object.has(key) ? object.at(key).number(low, high) : absent;
}

Laser laser_from(const JsonField& field, double column_s) {
  field.only({"elevation_deg", "azimuth_offset_deg", "time_offset_s"});
  Laser laser;
  laser.elevation_rad = field.at("elevation_deg").number(-90.0, 90.0) * kRadPerDeg;
  laser.azimuth_offset_rad =
      number_or(field, "azimuth_offset_deg", -180.0, 180.0, 0.0) * kRadPerDeg;
  laser.time_offset_s = number_or(field, "time_offset_s", 0.0, column_s, 0.0);
  return laser;
}

/// Bounds are wider than any sensor on sale; they catch other units.
SensorProperties properties_from(const JsonField& root) {
  SensorProperties properties;
  properties.name = root.at("name").text();
  properties.period_s = 1.0 / root.at("rate_hz").number(1.0, 50.0);
  properties.min_range_m = root.at("min_range_m").number(0.0, 100.0);
  properties.max_range_m = root.at("max_range_m").number(1.0, 1000.0);
  if (!(properties.max_range_m > properties.min_range_m)) {
    root.at("max_range_m").refuse("more than min_range_m");
  }
  properties.half_range_m = number_or(root, "half_range_m", 1.0, 10000.0, properties.max_range_m);
  properties.range_noise_m = root.at("range_noise_m").number(0.0, 1.0);
  properties.ring_bias_m = number_or(root, "ring_bias_m", 0.0, 1.0, properties.ring_bias_m);
  properties.divergence_rad = root.at("divergence_rad").number(0.0, 0.1);
  properties.echo_separation_m =
      number_or(root, "echo_separation_m", 0.0, 10.0, properties.echo_separation_m);
  properties.range_step_m = number_or(root, "range_step_m", 0.0, 1.0, properties.range_step_m);
  properties.height_m = root.at("height_m").number(0.1, 10.0);
  return properties;
}

}  // namespace

SpinningSpec read_sensor_file(const std::filesystem::path& file) {
  const nlohmann::json json = maps::parse_json(maps::read_text(file, kMaxBytes), file.string());
  const JsonField root(json, file.string());
  root.only({"format", "version", "name", "rate_hz", "min_range_m", "max_range_m", "half_range_m",
             "range_noise_m", "ring_bias_m", "divergence_rad", "echo_separation_m", "range_step_m",
             "height_m", "direction", "columns", "beams"});
  if (root.at("format").text() != "stillmap-sensor") root.at("format").refuse("stillmap-sensor");
  static_cast<void>(root.at("version").integer(1, 1));
  SpinningSpec spec;
  spec.properties = properties_from(root);
  spec.clockwise =
      root.at("direction").one_of<bool>({{"clockwise", true}, {"counter_clockwise", false}});
  spec.columns = static_cast<std::size_t>(root.at("columns").integer(1, kMaxColumns));
  const double column_s = spec.properties.period_s / static_cast<double>(spec.columns);
  for (const JsonField& beam : root.at("beams").elements(1, kMaxBeams))
    spec.lasers.push_back(laser_from(beam, column_s));
  return spec;
}

}  // namespace stillmap::simulation
