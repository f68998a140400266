#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "bags/bag.hpp"
#include "bags/pcap_records.hpp"

namespace stillmap::maps::pcap {

/// A capture of a Velodyne's packets, read as a bag: each sensor is a topic, named by the address
/// that it sends from and the port that it sends to ("192.168.1.201:2368"), and each sweep a
/// VelodyneScan of ROS 1, stamped by its first packet. Frames are named as their topics.
///
/// A sweep ends where the azimuth goes back: where it passes 0, or where the sensor's field of view
/// begins again. It begins with a whole packet. It also ends after 0.4 s, twice as long as the
/// slowest turn. The first and the last sweep of a sensor are left out if they have less than half
/// the packets of their neighbour: capturing began or ended within the turn.
class PcapBag final : public Bag {
 public:
  /// Goes through the file once. 24 bytes a sweep are held in memory.
  /// @param shown_as  what it is called, where that is another.
  /// @throws InputError for a file that is no capture, or has no packet of a Velodyne;
  /// StorageError.
  explicit PcapBag(const std::filesystem::path& file, const std::filesystem::path& shown_as = {});

  [[nodiscard]] BagFormat format() const override { return BagFormat::kPcap; }
  [[nodiscard]] const std::filesystem::path& file() const override { return capture_.file(); }
  [[nodiscard]] const std::vector<BagTopic>& topics() const override { return topics_; }
  BagDamage visit(std::span<const std::size_t> head_bytes, const Take& take) const override;
  [[nodiscard]] FileBytes read(const MessagePlace& place) const override;

 private:
  /// Of the first packet.
  struct Sweep {
    std::uint64_t offset = 0;
    std::int64_t stamp_ns = 0;
    std::uint32_t packets = 0;
    std::uint32_t topic = 0;
  };
  class Index;

  void set_sweeps(std::vector<std::vector<Sweep>> by_topic);
  /// The message up to its packets.
  [[nodiscard]] std::vector<std::byte> head_of(const Sweep& sweep) const;
  [[nodiscard]] std::size_t size_of(const Sweep& sweep) const;

  CaptureFile capture_;
  std::vector<BagTopic> topics_;
  /// Who sends each topic.
  struct Sender {
    std::uint32_t source = 0;
    std::uint16_t port = 0;
    auto operator<=>(const Sender&) const = default;
  };
  std::vector<Sender> senders_;
  /// In the order of the file.
  std::vector<Sweep> sweeps_;
  BagDamage damage_;
};

}  // namespace stillmap::maps::pcap
