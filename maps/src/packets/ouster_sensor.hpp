#pragma once

#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// How an Ouster packs a pixel: a UDP profile of its sensor documentation.
struct OusterProfile {
  std::string_view name;
  std::size_t pixel_bytes = 0;
  std::size_t returns = 1;
  /// Ranges of 15 bits in 8 mm, else in mm.
  bool is_short = false;
  /// Where the first return's reflectivity lies [bytes]. A second return's lies 4 after it.
  std::size_t reflectivity_at = 0;
  /// Where the first return's signal lies [bytes], 0 without one. A second return's lies 2 after
  /// it.
  std::size_t signal_at = 0;
};

/// What the packets of an Ouster need to become points.
struct OusterSensor {
  const OusterProfile* profile = nullptr;
  /// Columns of a turn, and of a packet.
  std::size_t columns = 0;
  std::size_t packet_columns = 0;
  /// Of each pixel of a column: up, and clockwise from the encoder's angle.
  std::vector<double> altitude_rad;
  std::vector<double> azimuth_rad;
  /// Where the beams begin, beside the axis and along it, at the encoder's zero.
  double beam_x_m = 0.0;
  double beam_z_m = 0.0;
  /// From the lidar's frame (`os_lidar`, x towards the connector) to the sensor's (`os_sensor`).
  Eigen::Isometry3d T_sensor_lidar = Eigen::Isometry3d::Identity();

  /// Old packets have no header of their own; each column ends with its status.
  [[nodiscard]] bool has_packet_header() const;
  [[nodiscard]] std::size_t packet_header_bytes() const;
  [[nodiscard]] std::size_t column_header_bytes() const;
  [[nodiscard]] std::size_t column_bytes() const;
  [[nodiscard]] std::size_t packet_bytes() const;
};

/// What an Ouster tells of itself (`ouster-cli SOURCE info`, the topic `metadata` of its driver,
/// `http://SENSOR/api/v1/sensor/metadata`), nested as firmware 2.0 and later writes it, or flat as
/// older drivers keep it. Where the beams begin may be missing: then the place in OS-1, OS-0 or
/// OS-2. Source: https://static.ouster.dev/sensor-docs, "Metadata" and "Coordinate frames".
/// @param name  for messages. @throws InputError naming it, the field and what is needed.
[[nodiscard]] OusterSensor read_ouster_metadata(std::string_view text, const std::string& name);

/// What a packet says before its columns.
struct OusterPacketHead {
  /// Counts turns of the sensor, modulo 65536.
  std::uint16_t turn = 0;
  /// Of its first column, by the sensor's clock [ns].
  std::int64_t stamp_ns = 0;
};

/// Bytes that `ouster_packet_head` needs.
inline constexpr std::size_t kOusterHeadBytes = 40;

/// What is known without the metadata: packets of the old profile have sizes that others have not.
/// @param head  at least `kOusterHeadBytes` from the packet's start. @param packet_bytes  of all.
/// @return nothing for a packet of another kind: of the IMU, of zones.
[[nodiscard]] std::optional<OusterPacketHead> ouster_packet_head(std::span<const std::byte> head,
                                                                 std::size_t packet_bytes);

}  // namespace stillmap::maps
