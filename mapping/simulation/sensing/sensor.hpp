#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::simulation {

inline constexpr double kRadPerDeg = std::numbers::pi / 180.0;

/// One ray of a sweep.
struct Beam {
  /// Unit vector in the lidar frame.
  Eigen::Vector3f direction = Eigen::Vector3f::UnitX();
  /// Where it leaves from, and ranges are counted from [m].
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();
  /// When it is fired, relative to the scan's stamp [s].
  float time_s = 0.0F;
  /// Number of the laser, top one 0; 0 for sensors without rings.
  std::uint16_t ring = 0;
};

/// How a sensor measures ranges and brightness.
struct SensorProperties {
  std::string name;
  /// Between two stamps [s].
  double period_s = 0.1;
  /// Returns outside of it are not reported [m].
  double min_range_m = 0.9;
  double max_range_m = 120.0;
  /// Range at which a white sheet (reflectivity 1, met head on) is seen in half of the shots [m].
  double half_range_m = 120.0;
  /// Standard deviation of a range [m]: of each shot, and of the constant error of each ring.
  double range_noise_m = 0.02;
  double ring_bias_m = 0.01;
  /// Full divergence of the beam [rad], and how far two echoes must be apart to be told apart [m].
  double divergence_rad = 0.002;
  double echo_separation_m = 0.6;
  /// Step that ranges are rounded to [m]; 0 = none.
  double range_step_m = 0.002;
  /// Above the ground it stands on, when on a vehicle [m].
  double height_m = 1.73;
  std::size_t rings = 0;
};

/// The rays of a sensor. Their order is that of the points in its files: the rays next to each
/// other in time and direction follow each other.
class Sensor {
 public:
  virtual ~Sensor() = default;
  [[nodiscard]] virtual const SensorProperties& properties() const = 0;
  /// Rays of scan number `scan`; the same for every scan of a spinning sensor. Times lie within
  /// half a period of the stamp.
  [[nodiscard]] virtual const std::vector<Beam>& beams(std::size_t scan) = 0;
};

/// A sensor by its name (`sensor_names()`), or from a file that describes one.
/// @throws std::invalid_argument for an unknown name that is no file either, maps::InputError for
/// a broken file.
[[nodiscard]] std::unique_ptr<Sensor> make_sensor(const std::string& name_or_file);

/// "hdl64 os1-64 os1-128 vlp16 avia".
[[nodiscard]] std::string sensor_names();

}  // namespace stillmap::simulation
