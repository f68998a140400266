#include "sensing/rosette_sensor.hpp"

#include <cmath>
#include <numbers>

namespace stillmap::simulation {
namespace {

constexpr double kRadPerSecondPerRpm = 2.0 * std::numbers::pi / 60.0;

// Livox Avia user manual 1.0: 240,000 points/s (first return), 70.4 x 77.2 degrees of view,
// and 70.4 x 4.5 in the repetitive mode, where the prisms draw a line: 4.5 degrees is the height of
// the 6 lasers' array, and the rosette of one laser is 70.4 x (77.2 - 4.5).
constexpr double kPointsPerSecond = 240'000.0;
constexpr std::size_t kLasers = 6;
constexpr double kArrayDeg = 4.5;
constexpr double kRosetteWidthDeg = 70.4;
constexpr double kRosetteHeightDeg = 77.2 - kArrayDeg;

// The Avia's own speeds are not published. These are those of the Mid-40, which works alike: Liu,
// Wu, Zhu, "Low-cost retina-like robotic lidars based on incommensurable scanning", IEEE/ASME
// Transactions on Mechatronics, 2021.
constexpr double kFirstPrismRadS = 7294.0 * kRadPerSecondPerRpm;
constexpr double kSecondPrismRadS = -4664.0 * kRadPerSecondPerRpm;

SensorProperties avia_properties() {
  SensorProperties properties;
  properties.name = "avia";
  // Manual: blind below 1 m, 450 m at most, 320 m for a sheet of reflectivity 0.8 in sunlight;
  // light that comes back falls with the square of the range, hence the white sheet's.
  properties.min_range_m = 1.0;
  properties.max_range_m = 450.0;
  properties.half_range_m = 320.0 / std::sqrt(0.8);
  // Manual: 2 cm at 20 m (1 sigma).
  properties.range_noise_m = 0.02;
  // Manual: 0.03 x 0.28 degrees; a round beam of the same area.
  properties.divergence_rad = std::sqrt(0.03 * 0.28) * kRadPerDeg;
  // Livox' packets count millimetres.
  properties.range_step_m = 0.001;
  properties.rings = kLasers;
  return properties;
}

/// Each thin prism bends the beam by a constant angle that turns with it, and small deflections add
/// up (first-order Risley prisms; eq. (2) to (4) of Liu et al.): with both bending half of the
/// view's radius a each, the angle from the axis is r = a |cos((w1 - w2) t / 2)|, a rose.
/// @param time_s  since the drive's start.
Eigen::Vector3f direction_at(double time_s, std::size_t laser) {
  const double first_rad = std::fmod(kFirstPrismRadS * time_s, 2.0 * std::numbers::pi);
  const double second_rad = std::fmod(kSecondPrismRadS * time_s, 2.0 * std::numbers::pi);
  const double across = 0.5 * (std::cos(first_rad) + std::cos(second_rad));
  const double up = 0.5 * (std::sin(first_rad) + std::sin(second_rad));
  const double above_axis = 0.5 - static_cast<double>(laser) / (kLasers - 1.0);
  const double azimuth = 0.5 * kRosetteWidthDeg * kRadPerDeg * across;
  const double elevation = (0.5 * kRosetteHeightDeg * up + kArrayDeg * above_axis) * kRadPerDeg;
  return Eigen::Vector3d(std::cos(elevation) * std::cos(azimuth),
                         std::cos(elevation) * std::sin(azimuth), std::sin(elevation))
      .cast<float>();
}

class Avia final : public Sensor {
 public:
  [[nodiscard]] const SensorProperties& properties() const override { return properties_; }

  [[nodiscard]] const std::vector<Beam>& beams(std::size_t scan) override {
    const auto count =
        static_cast<std::size_t>(std::lround(kPointsPerSecond * properties_.period_s));
    const double stamp_s = static_cast<double>(scan) * properties_.period_s;
    beams_.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      const double time_s = static_cast<double>(i) / kPointsPerSecond - 0.5 * properties_.period_s;
      const std::size_t laser = i % kLasers;
      beams_[i] = {.direction = direction_at(stamp_s + time_s, laser),
                   .time_s = static_cast<float>(time_s),
                   .ring = static_cast<std::uint16_t>(laser)};
    }
    return beams_;
  }

 private:
  SensorProperties properties_ = avia_properties();
  std::vector<Beam> beams_;
};

}  // namespace

std::unique_ptr<Sensor> make_avia() { return std::make_unique<Avia>(); }

}  // namespace stillmap::simulation
