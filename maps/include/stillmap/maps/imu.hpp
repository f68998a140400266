#pragma once

#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stillmap::maps {

/// How the lidar turned during a sweep.
class SweepTurn {
 public:
  /// It did not.
  SweepTurn() = default;
  /// @param times_s  relative to the stamp, increasing, at least two.
  /// @param R_stamp_then  rotations, one a time.
  /// @throws std::invalid_argument for fewer than two times, or another number of rotations.
  SweepTurn(std::vector<float> times_s, std::vector<Eigen::Matrix3f> R_stamp_then);

  [[nodiscard]] bool is_none() const { return times_s_.empty(); }
  /// Rotation that takes points from the lidar's axes at a time to those at the stamp. Linear
  /// between two times: over 10 ms at 4 rad/s that is off by 0.2 mrad.
  [[nodiscard]] Eigen::Matrix3f at(float time_s) const;

 private:
  std::vector<float> times_s_;
  std::vector<Eigen::Matrix3f> R_stamp_then_;
};

/// What an IMU measured at one time, in the axes of the lidar.
struct ImuReading {
  /// By the clock of the IMU's messages.
  std::int64_t stamp_ns = 0;
  /// Angular velocity [rad/s].
  Eigen::Vector3f rate_radps = Eigen::Vector3f::Zero();
  /// Specific force [m/s^2]: gravity's reaction, upward, while the sensor stands.
  Eigen::Vector3f force_mps2 = Eigen::Vector3f::Zero();
};

/// The year 2096. Stamps within it, of either sign, have differences that fit into 64 bits [ns].
inline constexpr std::int64_t kMostImuStampNs = 4'000'000'000'000'000'000;
/// A drive has no more: 14 hours at 200 Hz, 320 MB.
inline constexpr std::size_t kMostImuReadings = 10'000'000;

/// The IMU of a drive. 32 bytes a reading are held in memory: 23 MB for an hour of 200 Hz.
struct Imu {
  /// "imu.csv", or the topic.
  std::string source;
  /// At least two, stamps increasing, all finite.
  std::shared_ptr<const std::vector<ImuReading>> readings;
  /// How the IMU's clock and its gyroscope are off, once this was found.
  struct Fit {
    /// To be added to the readings' stamps [ns].
    std::int64_t clock_offset_ns = 0;
    /// Rate that it tells at rest [rad/s].
    Eigen::Vector3d bias_radps = Eigen::Vector3d::Zero();
  };
  std::optional<Fit> fit;

  /// Mean number of readings a second [Hz], and the longest time between two [s].
  [[nodiscard]] double rate_hz() const;
  [[nodiscard]] double longest_gap_s() const;
};

/// Readings as a file or a bag has them, made usable: sorted by stamp, doubles and what is not
/// finite left out. Specific force in g, as Livox's drivers send it, becomes m/s^2: if its median
/// norm is in (0.9, 1.1).
/// @param notes  gets what was done, for people.
/// @return null for fewer than two.
[[nodiscard]] std::shared_ptr<const std::vector<ImuReading>> usable_readings(
    std::vector<ImuReading> readings, const std::string& source, std::vector<std::string>& notes);

/// Whether the first line of a file names the columns that `read_imu_csv` needs. @throws
/// StorageError.
[[nodiscard]] bool has_imu_columns(const std::filesystem::path& file);

/// `imu.csv` beside scans: a header that names the columns stamp_ns, wx, wy, wz [rad/s], ax, ay, az
/// [m/s^2] in the lidar's axes, in any order; others are ignored.
/// Stamps are at most `kMostImuStampNs`.
/// The file has at most 1 GiB.
/// @throws InputError naming file, line and what is missing or no number, or for more readings;
/// StorageError.
[[nodiscard]] std::vector<ImuReading> read_imu_csv(const std::filesystem::path& file,
                                                   std::size_t most_readings = kMostImuReadings);

/// Rotation R_from_to of the lidar between two stamps of the scans' clock, from the gyroscope.
/// @param fit  of the readings.
/// @return nothing where readings are missing: a gap of more than 50 ms.
[[nodiscard]] std::optional<Eigen::Matrix3d> turn_between_stamps(
    std::span<const ImuReading> readings, const Imu::Fit& fit, std::int64_t from_ns,
    std::int64_t to_ns);

/// Of the sweep of a scan. Null for a scan without times, or without readings for its sweep.
[[nodiscard]] std::shared_ptr<const SweepTurn> turn_of(const Scan& scan,
                                                       std::span<const ImuReading> readings,
                                                       const Imu::Fit& fit);

/// Turns points to the lidar's orientation at the scan's stamp, each from its own time. Afterwards
/// the cloud's `turn` is none at all times. Does nothing without one.
void turn_to_stamp(PointCloud& cloud);

}  // namespace stillmap::maps
