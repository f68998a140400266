#include "sensing/spinning_sensor.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace stillmap::simulation {
namespace {

constexpr double kTurnRad = 2.0 * std::numbers::pi;

struct TimedAzimuth {
  /// In [0, 2 pi).
  double azimuth_rad;
  double time_s;
};

/// Middle of the lasers' times in a column [s]: the column's own time.
double column_middle_s(const std::vector<Laser>& lasers) {
  const auto [first, last] = std::minmax_element(
      lasers.begin(), lasers.end(),
      [](const Laser& a, const Laser& b) { return a.time_offset_s < b.time_offset_s; });
  return lasers.empty() ? 0.0 : 0.5 * (first->time_offset_s + last->time_offset_s);
}

double rounded(double value, double step) {
  return step > 0.0 ? step * std::round(value / step) : value;
}

/// Where and when one laser fires in a turn, by azimuth.
std::vector<TimedAzimuth> firings_of(const SpinningSpec& spec, const Laser& laser) {
  const double time_in_column_s = laser.time_offset_s - column_middle_s(spec.lasers);
  const double period_s = spec.properties.period_s;
  const double rate_rad_s = (spec.clockwise ? -kTurnRad : kTurnRad) / period_s;
  std::vector<TimedAzimuth> firings;
  firings.reserve(spec.columns);
  for (std::size_t column = 0; column < spec.columns; ++column) {
    const double share = (static_cast<double>(column) + 0.5) / static_cast<double>(spec.columns);
    const double time_s = (share - 0.5) * period_s + time_in_column_s;
    const double head_rad = rounded(rate_rad_s * time_s, spec.encoder_step_rad);
    double azimuth_rad = std::fmod(head_rad + laser.azimuth_offset_rad, kTurnRad);
    // The last bits of a full turn are none.
    if (azimuth_rad < -1e-12) azimuth_rad += kTurnRad;
    firings.push_back({std::max(azimuth_rad, 0.0), time_s});
  }
  std::stable_sort(firings.begin(), firings.end(),
                   [](const auto& a, const auto& b) { return a.azimuth_rad < b.azimuth_rad; });
  return firings;
}

Eigen::Vector3f direction_of(double azimuth_rad, double elevation_rad) {
  const double level = std::cos(elevation_rad);
  return Eigen::Vector3d(level * std::cos(azimuth_rad), level * std::sin(azimuth_rad),
                         std::sin(elevation_rad))
      .cast<float>();
}

Eigen::Vector3f origin_of(const Laser& laser, double azimuth_rad) {
  return Eigen::Vector3d(-laser.left_m * std::sin(azimuth_rad),
                         laser.left_m * std::cos(azimuth_rad), laser.up_m)
      .cast<float>();
}

class SpinningSensor final : public Sensor {
 public:
  explicit SpinningSensor(SpinningSpec spec) : properties_(std::move(spec.properties)) {
    spec.properties = properties_;
    properties_.rings = spec.lasers.size();
    std::stable_sort(spec.lasers.begin(), spec.lasers.end(), [](const Laser& a, const Laser& b) {
      return a.elevation_rad > b.elevation_rad;
    });
    beams_.reserve(spec.lasers.size() * spec.columns);
    for (std::size_t ring = 0; ring < spec.lasers.size(); ++ring) {
      for (const TimedAzimuth& firing : firings_of(spec, spec.lasers[ring])) {
        const Laser& laser = spec.lasers[ring];
        beams_.push_back({.direction = direction_of(firing.azimuth_rad, laser.elevation_rad),
                          .origin = origin_of(laser, firing.azimuth_rad),
                          .time_s = static_cast<float>(firing.time_s),
                          .ring = static_cast<std::uint16_t>(ring)});
      }
    }
  }

  [[nodiscard]] const SensorProperties& properties() const override { return properties_; }
  [[nodiscard]] const std::vector<Beam>& beams(std::size_t /*scan*/) override { return beams_; }

 private:
  SensorProperties properties_;
  std::vector<Beam> beams_;
};

}  // namespace

std::unique_ptr<Sensor> make_spinning_sensor(SpinningSpec spec) {
  return std::make_unique<SpinningSensor>(std::move(spec));
}

}  // namespace stillmap::simulation
