#include "sensing/sensor_file.hpp"

#include "sensing/sensor.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>

namespace stillmap::simulation {
namespace {

// The largest sensors on sale have 128 lasers and 4096 columns.
constexpr std::size_t kMaxBeams = 256;
constexpr double kMaxColumns = 8192.0;
constexpr std::uintmax_t kMaxBytes = 1 << 20;

/// Messages stay one line, whatever the file holds.
std::string shown(const nlohmann::json& value) {
  if (value.is_structured()) return value.is_array() ? "an array" : "an object";
  constexpr std::size_t kLongest = 60;
  const std::string text = value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return text.size() > kLongest ? text.substr(0, kLongest) + "..." : text;
}

/// An object whose keys are taken one by one; what is left at the end is not known.
class Keys {
 public:
  Keys(const nlohmann::json& object, std::string where)
      : object_(object), where_(std::move(where)) {
    if (!object.is_object()) throw maps::InputError(where_, shown(object), "an object");
  }

  [[noreturn]] void refuse(const std::string& key, const std::string& expected) const {
    const auto found = object_.find(key);
    throw maps::InputError(where_ + "." + key, found == object_.end() ? "nothing" : shown(*found),
                           expected);
  }
  [[nodiscard]] bool has(const std::string& key) const { return object_.contains(key); }

  [[nodiscard]] double number(const std::string& key, double low, double high) {
    taken_.insert(key);
    const auto found = object_.find(key);
    const std::string expected = fmt::format("a number from {} to {}", low, high);
    if (found == object_.end() || !found->is_number()) refuse(key, expected);
    const double value = found->get<double>();
    if (!(value >= low && value <= high)) refuse(key, expected);
    return value;
  }
  [[nodiscard]] double number_or(const std::string& key, double low, double high, double absent) {
    return has(key) ? number(key, low, high) : absent;
  }
  [[nodiscard]] std::string text(const std::string& key, const std::string& expected) {
    taken_.insert(key);
    const auto found = object_.find(key);
    if (found == object_.end() || !found->is_string()) refuse(key, expected);
    return found->get<std::string>();
  }
  [[nodiscard]] std::size_t whole(const std::string& key, double low, double high) {
    const double value = number(key, low, high);
    if (!object_.at(key).is_number_integer()) refuse(key, "a whole number");
    return static_cast<std::size_t>(value);
  }
  [[nodiscard]] const nlohmann::json& array(const std::string& key, std::size_t longest) {
    taken_.insert(key);
    const auto found = object_.find(key);
    if (found == object_.end() || !found->is_array() || found->empty() || found->size() > longest) {
      refuse(key, fmt::format("an array of 1 to {}", longest));
    }
    return *found;
  }

  void refuse_others() const {
    for (const auto& item : object_.items()) {
      if (taken_.contains(item.key())) continue;
      std::string known;
      for (const std::string& key : taken_) known += ' ' + key;
      throw maps::InputError(where_ + "." + item.key().substr(0, 60), shown(item.value()),
                             "only the keys" + known);
    }
  }

 private:
  const nlohmann::json& object_;
  std::string where_;
  std::set<std::string> taken_;
};

nlohmann::json parse(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) {
    throw maps::InputError(file.string(), "no file", "the JSON file of a sensor");
  }
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  if (!error && size > kMaxBytes) {
    throw maps::InputError(file.string(), fmt::format("{} bytes", size),
                           fmt::format("at most {}", kMaxBytes));
  }
  std::ifstream stream(file, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  if (!stream) throw maps::StorageError(file.string(), std::strerror(errno));
  try {
    return nlohmann::json::parse(text);
  } catch (const nlohmann::json::exception& broken) {
    throw maps::InputError(file.string(), broken.what(), "JSON");
  }
}

Laser laser_from(const nlohmann::json& json, const std::string& where, double column_s) {
  Keys keys(json, where);
  Laser laser;
  laser.elevation_rad = keys.number("elevation_deg", -90.0, 90.0) * kRadPerDeg;
  laser.azimuth_offset_rad = keys.number_or("azimuth_offset_deg", -180.0, 180.0, 0.0) * kRadPerDeg;
  laser.time_offset_s = keys.number_or("time_offset_s", 0.0, column_s, 0.0);
  keys.refuse_others();
  return laser;
}

/// Bounds are wider than any sensor on sale; they catch other units.
SensorProperties properties_from(Keys& keys) {
  SensorProperties properties;
  properties.name = keys.text("name", "a text");
  properties.period_s = 1.0 / keys.number("rate_hz", 1.0, 50.0);
  properties.min_range_m = keys.number("min_range_m", 0.0, 100.0);
  properties.max_range_m = keys.number("max_range_m", 1.0, 1000.0);
  if (!(properties.max_range_m > properties.min_range_m)) {
    keys.refuse("max_range_m", "more than min_range_m");
  }
  properties.half_range_m = keys.number_or("half_range_m", 1.0, 10000.0, properties.max_range_m);
  properties.range_noise_m = keys.number("range_noise_m", 0.0, 1.0);
  properties.ring_bias_m = keys.number_or("ring_bias_m", 0.0, 1.0, properties.ring_bias_m);
  properties.divergence_rad = keys.number("divergence_rad", 0.0, 0.1);
  properties.echo_separation_m =
      keys.number_or("echo_separation_m", 0.0, 10.0, properties.echo_separation_m);
  properties.range_step_m = keys.number_or("range_step_m", 0.0, 1.0, properties.range_step_m);
  properties.height_m = keys.number("height_m", 0.1, 10.0);
  return properties;
}

}  // namespace

SpinningSpec read_sensor_file(const std::filesystem::path& file) {
  const nlohmann::json json = parse(file);
  Keys keys(json, file.string() + " at ");
  if (keys.text("format", "\"stillmap-sensor\"") != "stillmap-sensor") {
    keys.refuse("format", "\"stillmap-sensor\"");
  }
  if (keys.whole("version", 1.0, 1.0) != 1) keys.refuse("version", "1");
  SpinningSpec spec;
  spec.properties = properties_from(keys);
  const std::string direction = keys.text("direction", "clockwise or counter_clockwise");
  spec.clockwise = direction == "clockwise";
  if (!spec.clockwise && direction != "counter_clockwise") {
    keys.refuse("direction", "clockwise or counter_clockwise");
  }
  spec.columns = keys.whole("columns", 1.0, kMaxColumns);
  const double column_s = spec.properties.period_s / static_cast<double>(spec.columns);
  const nlohmann::json& beams = keys.array("beams", kMaxBeams);
  for (std::size_t i = 0; i < beams.size(); ++i) {
    spec.lasers.push_back(
        laser_from(beams[i], fmt::format("{} at .beams[{}]", file.string(), i), column_s));
  }
  keys.refuse_others();
  return spec;
}

}  // namespace stillmap::simulation
