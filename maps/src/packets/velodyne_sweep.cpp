#include "packets/velodyne_sweep.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/recording_choice.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "formats/point_table.hpp"
#include "packets/packet_bytes.hpp"

namespace stillmap::maps {
namespace {

constexpr std::size_t kBlocks = 12;
constexpr std::size_t kBlockBytes = 100;
constexpr std::size_t kReturnsOfBlock = 32;
constexpr std::size_t kReturnMode = 1204;
constexpr std::size_t kFactory = 1205;
constexpr std::uint8_t kDualReturn = 0x39;
constexpr std::uint32_t kFullTurn = 36'000;
constexpr double kRadPerUnit = 2.0 * std::numbers::pi / kFullTurn;
/// Between the first firing and the start of a VLS-128's packet [us], 63-9483.
constexpr double kVlsStartUs = -8.7;

/// First laser of the bank that a block's flag names; nothing for another flag.
std::optional<std::size_t> bank_of(std::uint32_t flag) {
  switch (flag) {
    case 0xeeff:
      return 0;
    case 0xddff:
      return 32;
    case 0xccff:
      return 64;
    case 0xbbff:
      return 96;
    default:
      return std::nullopt;
  }
}

}  // namespace

struct VelodyneSweep::Block {
  std::span<const std::byte> returns;
  /// The same firing's other return, where it came before; else empty.
  std::span<const std::byte> other;
  std::uint32_t azimuth = 0;
  std::size_t bank = 0;
  /// From the packet's first firing sequence [us].
  double from_packet_us = 0.0;
};

VelodyneSweep::VelodyneSweep(std::span<const VelodyneLaser> lasers, std::string name)
    : lasers_(lasers.begin(), lasers.end()), name_(std::move(name)) {}

void VelodyneSweep::set_model(std::span<const std::byte> packet) {
  const auto factory = std::to_integer<std::uint8_t>(packet[kFactory]);
  // An HDL-64E's last bytes are a status, which may look like another's model.
  const bool has_two_banks = integer_at<std::uint16_t>(packet, kBlockBytes) == 0xddff &&
                             integer_at<std::uint16_t>(packet, 2 * kBlockBytes) == 0xeeff;
  const VelodyneModel* const model = has_two_banks ? &velodyne_hdl64e() : velodyne_model(factory);
  if (model == nullptr)
    throw InputError(name_, fmt::format("a packet of factory byte {:#04x}", factory),
                     "one of VLP-16, Puck Hi-Res, HDL-32E, VLP-32C, VLS-128 or HDL-64E: let the "
                     "sensor's own driver write PointCloud2");
  if (model_ != nullptr && model_ != model)
    throw InputError(name_, fmt::format("packets of {} and {}", model_->name, model->name),
                     "packets of one sensor: record each on a topic of its own");
  if (model_ == model) return;
  model_ = model;
  if (lasers_.empty()) lasers_ = usual_lasers(*model);
  if (lasers_.size() != model->lasers)
    throw CalibrationError(
        name_,
        lasers_.empty() ? fmt::format("packets of {}, whose lasers differ from sensor "
                                      "to sensor",
                                      model->name)
                        : fmt::format("packets of {} and a calibration of {} lasers", model->name,
                                      lasers_.size()),
        fmt::format("the sensor's calibration of {} lasers: give "
                    "'BAG?calibration=NAME', a file of velodyne_pointcloud beside the bag",
                    model->lasers));
}

std::vector<VelodyneSweep::Block> VelodyneSweep::blocks_of(
    std::span<const std::byte> packet) const {
  const bool is_dual = model_ != &velodyne_hdl64e() &&
                       std::to_integer<std::uint8_t>(packet[kReturnMode]) == kDualReturn;
  const std::size_t banks = std::max<std::size_t>(model_->lasers / kReturnsOfBlock, 1);
  const std::size_t sequences_of_block = std::max<std::size_t>(kReturnsOfBlock / model_->lasers, 1);
  const std::size_t returns = is_dual ? 2 : 1;
  // Dual returns of 128 lasers fill eight of the twelve blocks.
  const std::size_t used = kBlocks / (banks * returns) * banks * returns;
  std::vector<Block> blocks;
  for (std::size_t i = 0; i < used; ++i) {
    const std::span<const std::byte> bytes = packet.subspan(i * kBlockBytes, kBlockBytes);
    const std::optional<std::size_t> bank = bank_of(integer_at<std::uint16_t>(bytes, 0));
    if (!bank || *bank >= std::max<std::size_t>(model_->lasers, kReturnsOfBlock)) continue;
    Block block{bytes.subspan(4), {}, integer_at<std::uint16_t>(bytes, 2), *bank, 0.0};
    if (block.azimuth > kFullTurn)
      throw InputError(name_, fmt::format("an azimuth of {} hundredths of a degree", block.azimuth),
                       "at most 36000: record the packets again");
    block.from_packet_us =
        model_->sequence_us * static_cast<double>(i / (banks * returns) * sequences_of_block);
    if (is_dual && i % 2 == 1) block.other = packet.subspan((i - 1) * kBlockBytes + 4, 96);
    blocks.push_back(block);
  }
  return blocks;
}

void VelodyneSweep::set_rate(const std::vector<Block>& blocks, double from_stamp_s) {
  if (blocks.empty()) return;
  const Block &first = blocks.front(), &last = blocks.back();
  const auto before = std::exchange(before_, Start{first.azimuth, from_stamp_s});
  const double us = last.from_packet_us - first.from_packet_us;
  if (us > 0.0) return set_rate(first.azimuth, last.azimuth, us);
  // A packet of one sequence: the packet before is one sequence earlier, if none was lost.
  if (before && 1e6 * (from_stamp_s - before->from_stamp_s) < 1.5 * model_->sequence_us)
    set_rate(before->azimuth, first.azimuth, model_->sequence_us);
}

void VelodyneSweep::set_rate(std::uint32_t from, std::uint32_t to, double us) {
  // A turn at 20 Hz takes 50 ms.
  constexpr double kMostRadPerUs = 2.0 * std::numbers::pi / 40'000.0;
  const std::uint32_t turned = (to + kFullTurn - from) % kFullTurn;
  const double rate = turned * kRadPerUnit / us;
  if (rate <= kMostRadPerUs) rad_per_us_ = rate;
}

void VelodyneSweep::add(std::span<const std::byte> packet, double from_stamp_s) {
  if (packet.size() != kVelodynePacketBytes)
    throw InputError(name_, fmt::format("a packet of {} bytes", packet.size()),
                     fmt::format("{}: record the packets again", kVelodynePacketBytes));
  set_model(packet);
  const std::vector<Block> blocks = blocks_of(packet);
  set_rate(blocks, from_stamp_s);
  for (const Block& block : blocks) add_block(block, from_stamp_s);
}

void VelodyneSweep::add_block(const Block& block, double from_stamp_s) {
  for (std::size_t j = 0; j < kReturnsOfBlock; ++j) {
    const std::size_t laser = (block.bank + j) % model_->lasers;
    const std::size_t sequence = (block.bank + j) / model_->lasers;
    std::size_t group = laser / model_->lasers_at_once;
    // A VLS-128 pauses for a group's time in the middle and at the end of a sequence.
    if (model_->lasers == 128) group += laser / 64;
    const double from_block_us = model_->sequence_us * static_cast<double>(sequence) +
                                 model_->group_us * static_cast<double>(group);
    const std::uint32_t range = integer_at<std::uint16_t>(block.returns, 3 * j);
    const bool is_again =
        !block.other.empty() && integer_at<std::uint16_t>(block.other, 3 * j) == range;
    cloud_.intensities.push_back(std::to_integer<std::uint8_t>(block.returns[3 * j + 2]));
    const double start_us = model_->lasers == 128 ? kVlsStartUs : 0.0;
    cloud_.time_offsets_s.push_back(static_cast<float>(
        from_stamp_s + 1e-6 * (block.from_packet_us + from_block_us + start_us)));
    if (range == 0 || is_again)
      cloud_.positions.emplace_back(0.0F, 0.0F, 0.0F);
    else
      add_point(lasers_[laser], model_->range_step_m * range,
                block.azimuth * kRadPerUnit + rad_per_us_ * from_block_us);
  }
}

void VelodyneSweep::add_point(const VelodyneLaser& laser, double range_m, double azimuth_rad) {
  const double angle = azimuth_rad - laser.azimuth_rad;
  const double c = std::cos(angle), s = std::sin(angle);
  const double ce = std::cos(laser.elevation_rad), se = std::sin(laser.elevation_rad);
  const double far = range_m + laser.range_m;
  // Along the sensor's x (right) and y (ahead), as for a range.
  const auto right = [&](double r) {
    return (r * ce - laser.vertical_offset_m * se) * s - laser.horizontal_offset_m * c;
  };
  const auto ahead = [&](double r) {
    return (r * ce - laser.vertical_offset_m * se) * c + laser.horizontal_offset_m * s;
  };
  double range_x = far, range_y = far;
  if (laser.two_points) {
    // Between what a laser is off by near and at 25.04 m (HDL-64E S2 manual, appendix F).
    const double x = std::abs(right(far)), y = std::abs(ahead(far));
    range_x += (laser.range_m - laser.near_x_m) * (x - 2.4) / (25.04 - 2.4) + laser.near_x_m -
               laser.range_m;
    range_y += (laser.range_m - laser.near_y_m) * (y - 1.93) / (25.04 - 1.93) + laser.near_y_m -
               laser.range_m;
  }
  cloud_.positions.emplace_back(static_cast<float>(ahead(range_y)),
                                static_cast<float>(-right(range_x)),
                                static_cast<float>(range_y * se + laser.vertical_offset_m * ce));
}

DecodedScan VelodyneSweep::finish() && {
  DecodedScan scan;
  scan.points_in_file = cloud_.size();
  scan.cloud = std::move(cloud_);
  scan.dropped = drop_invalid(scan.cloud);
  return scan;
}

}  // namespace stillmap::maps
