#include "packets/ouster_sweep.hpp"

#include <stillmap/maps/recording_choice.hpp>

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <utility>

#include "formats/point_table.hpp"
#include "packets/packet_bytes.hpp"

namespace stillmap::maps {
namespace {

constexpr std::size_t kColumnNumberAt = 8;
constexpr std::size_t kStatusAt = 10;

bool is_valid_column(const OusterSensor& sensor, std::span<const std::byte> column) {
  if (!sensor.has_packet_header())
    return integer_at<std::uint32_t>(column, column.size() - 4) == 0xffffffffU;
  return (integer_at<std::uint16_t>(column, kStatusAt) & 1U) != 0;
}

/// Range of one return [m], 0 for none.
double range_m(const OusterProfile& profile, std::span<const std::byte> pixel, std::size_t number) {
  if (profile.is_short) return 0.008 * (integer_at<std::uint16_t>(pixel, 4 * number) & 0x7fffU);
  // The old profile has a bit more, and only flags above.
  const std::uint32_t mask = profile.name == "LEGACY" ? 0xfffffU : 0x7ffffU;
  return 0.001 * (integer_at<std::uint32_t>(pixel, 4 * number) & mask);
}

float intensity(const OusterProfile& profile, std::span<const std::byte> pixel,
                std::size_t number) {
  if (profile.signal_at > 0)
    return integer_at<std::uint16_t>(pixel, profile.signal_at + 2 * number);
  return integer_at<std::uint8_t>(pixel, profile.reflectivity_at + 4 * number);
}

}  // namespace

OusterSweep::OusterSweep(const OusterSensor& sensor, std::int64_t stamp_ns, std::string name)
    : sensor_(&sensor), stamp_ns_(stamp_ns), name_(std::move(name)) {}

void OusterSweep::add(std::span<const std::byte> packet) {
  if (packet.size() != sensor_->packet_bytes())
    throw CalibrationError(
        name_, fmt::format("a packet of {} bytes", packet.size()),
        fmt::format("{} bytes, as the metadata says ({} of {} x {} pixels): give the metadata that "
                    "belongs to this recording",
                    sensor_->packet_bytes(), sensor_->profile->name, sensor_->packet_columns,
                    sensor_->altitude_rad.size()));
  const std::size_t bytes = sensor_->column_bytes();
  for (std::size_t i = 0; i < sensor_->packet_columns; ++i)
    add_column(packet.subspan(sensor_->packet_header_bytes() + i * bytes, bytes));
}

void OusterSweep::add_column(std::span<const std::byte> column) {
  if (!is_valid_column(*sensor_, column)) return;
  const OusterProfile& profile = *sensor_->profile;
  // In doubles the difference of two stamps since 1970 would lose 0.2 us.
  const auto from_stamp_ns = static_cast<std::int64_t>(integer_at<std::uint64_t>(column, 0) -
                                                       static_cast<std::uint64_t>(stamp_ns_));
  const double from_stamp_s = 1e-9 * static_cast<double>(from_stamp_ns);
  if (std::abs(from_stamp_s) > static_cast<double>(kMaxTimeOffsetS) && !far_s_)
    far_s_ = from_stamp_s;
  const double column_number = integer_at<std::uint16_t>(column, kColumnNumberAt);
  const double encoder_rad =
      2.0 * std::numbers::pi * (1.0 - column_number / static_cast<double>(sensor_->columns));
  const double beam_m = std::hypot(sensor_->beam_x_m, sensor_->beam_z_m);
  for (std::size_t i = 0; i < sensor_->altitude_rad.size(); ++i) {
    const auto pixel = column.subspan(sensor_->column_header_bytes() + i * profile.pixel_bytes,
                                      profile.pixel_bytes);
    const double angle_rad = encoder_rad - sensor_->azimuth_rad[i];
    for (std::size_t j = 0; j < profile.returns; ++j) {
      const double range = range_m(profile, pixel, j);
      cloud_.intensities.push_back(intensity(profile, pixel, j));
      cloud_.time_offsets_s.push_back(static_cast<float>(from_stamp_s));
      if (range == 0.0) {
        cloud_.positions.emplace_back(0.0F, 0.0F, 0.0F);
        continue;
      }
      // The range counts from the lidar's origin, the beam starts beside it.
      const double flat = (range - beam_m) * std::cos(sensor_->altitude_rad[i]);
      const Eigen::Vector3d p_lidar(
          flat * std::cos(angle_rad) + sensor_->beam_x_m * std::cos(encoder_rad),
          flat * std::sin(angle_rad) + sensor_->beam_x_m * std::sin(encoder_rad),
          (range - beam_m) * std::sin(sensor_->altitude_rad[i]) + sensor_->beam_z_m);
      cloud_.positions.push_back((sensor_->T_sensor_lidar * p_lidar).cast<float>());
    }
  }
}

DecodedScan OusterSweep::finish() && {
  DecodedScan scan;
  scan.points_in_file = cloud_.size();
  scan.cloud = std::move(cloud_);
  if (far_s_) {
    scan.cloud.time_offsets_s.clear();
    scan.times_note = fmt::format(
        "the times of points are left out: a column of the scan lies {:.1f} s from its stamp",
        *far_s_);
  }
  scan.dropped = drop_invalid(scan.cloud);
  return scan;
}

}  // namespace stillmap::maps
