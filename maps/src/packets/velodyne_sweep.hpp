#pragma once

#include <stillmap/maps/scan_file.hpp>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "packets/velodyne_models.hpp"

namespace stillmap::maps {

/// Of a data packet of any Velodyne.
inline constexpr std::size_t kVelodynePacketBytes = 1206;
/// Most points of a packet: 12 blocks of 32 returns.
inline constexpr std::size_t kVelodynePacketPoints = 384;

/// Makes the points of a sweep from its packets, in the sensor's frame as ROS has it: x ahead
/// (azimuth 0 of the sensor), y left, z up.
///
/// Each laser gets the azimuth and the time of its own firing: the sensor goes on turning within a
/// packet. How fast is told by the packet, or by it and the one before. Of dual returns both are
/// taken, once where they are the same. Ranges of 0 are "no return".
class VelodyneSweep {
 public:
  /// @param lasers  of a calibration; empty: those of the model's manual.
  /// @param name    of the sweep, for messages.
  VelodyneSweep(std::span<const VelodyneLaser> lasers, std::string name);

  /// @param from_stamp_s  from the scan's stamp to the packet's first firing.
  /// @throws InputError for a packet of another size or model than those before, an azimuth beyond
  /// 360 deg, or an HDL-64E without calibration.
  void add(std::span<const std::byte> packet, double from_stamp_s);

  [[nodiscard]] DecodedScan finish() &&;

 private:
  struct Block;
  void set_model(std::span<const std::byte> packet);
  [[nodiscard]] std::vector<Block> blocks_of(std::span<const std::byte> packet) const;
  void set_rate(const std::vector<Block>& blocks, double from_stamp_s);
  /// @param from, to  azimuths so many us apart.
  void set_rate(std::uint32_t from, std::uint32_t to, double us);
  void add_block(const Block& block, double from_stamp_s);
  void add_point(const VelodyneLaser& laser, double range_m, double azimuth_rad);

  std::vector<VelodyneLaser> lasers_;
  std::string name_;
  const VelodyneModel* model_ = nullptr;
  /// Turn of the sensor, of the last packet that told it.
  double rad_per_us_ = 0.0;
  /// Where and when the packet before began.
  struct Start {
    std::uint32_t azimuth = 0;
    double from_stamp_s = 0.0;
  };
  std::optional<Start> before_;
  PointCloud cloud_;
};

}  // namespace stillmap::maps
