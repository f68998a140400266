#include "bags/pcap_bag.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <utility>

#include "bags/udp_packet.hpp"
#include "bags/velodyne_scan.hpp"
#include "packets/velodyne_sweep.hpp"

namespace stillmap::maps::pcap {
namespace {

/// Vehicles have up to ten. More would make reading slow, as their packets lie between each other.
constexpr std::size_t kMostSensors = 64;
/// As many points as `decode_velodyne_scan` takes; sensors send up to 2,500 a turn.
constexpr std::uint32_t kMostPackets = 10'000;
constexpr std::int64_t kLongestSweepNs = 400'000'000;
/// Hundredths of a degree by which an azimuth may go back within a sweep: the motor's.
constexpr std::uint32_t kMostBack = 100;
constexpr std::int64_t kNsOfSecond = 1'000'000'000;
/// Stamp and bytes.
constexpr std::size_t kPacketOfMessage = 8 + kVelodynePacketBytes;

/// A data packet begins with a block of the first bank.
bool is_data(std::span<const std::byte> payload) {
  return payload.size() == kVelodynePacketBytes &&
         integer_at<std::uint16_t>(payload, 0, false) == 0xeeff;
}

/// ROS 1 writes numbers without gaps, lowest byte first.
template <typename Integer>
void append_number(std::vector<std::byte>& message, Integer value) {
  for (std::size_t i = 0; i < sizeof(Integer); ++i)
    message.push_back(static_cast<std::byte>(value >> 8U * i & 0xffU));
}

void append_stamp(std::vector<std::byte>& message, std::int64_t stamp_ns) {
  append_number(message, static_cast<std::uint32_t>(stamp_ns / kNsOfSecond));
  append_number(message, static_cast<std::uint32_t>(stamp_ns % kNsOfSecond));
}

}  // namespace

/// Where each sweep begins.
class PcapBag::Index {
 public:
  /// @param senders  to be filled.
  explicit Index(std::vector<Sender>& senders) : senders_(senders) {}

  void take(const CapturedPacket& captured) {
    ++packets_;
    const UdpPacket packet = read_udp(captured);
    if (packet.kind == UdpPacket::Kind::kFragment) ++fragments_;
    if (packet.kind == UdpPacket::Kind::kCut) ++cut_;
    if (packet.kind == UdpPacket::Kind::kUnknownLink) links_.insert(captured.link);
    if (packet.kind != UdpPacket::Kind::kWhole || !is_data(packet.payload)) return;
    if (const std::optional<std::uint32_t> topic = topic_of({packet.source, packet.port}))
      add(*topic, captured, integer_at<std::uint16_t>(packet.payload, 2, false));
    else
      ++of_others_;
  }

  /// One list a sensor, in the order of the file.
  [[nodiscard]] std::vector<std::vector<Sweep>> sweeps() && { return std::move(sweeps_); }

  /// @return empty where there is nothing to say.
  [[nodiscard]] std::string left_out() const {
    std::string text;
    const auto say = [&](std::size_t count, const char* what) {
      if (count > 0) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, what);
    };
    say(fragments_, "fragments of larger packets");
    say(cut_, "packets that the capture shortened (record with tcpdump -s 0)");
    say(of_others_, "packets of further sensors");
    if (!links_.empty())
      text += fmt::format("{}packets of link type {}", text.empty() ? "" : ", ", *links_.begin());
    return text;
  }
  [[nodiscard]] std::size_t packets() const { return packets_; }

 private:
  std::optional<std::uint32_t> topic_of(const Sender& sender) {
    const auto found = topics_.find(sender);
    if (found != topics_.end()) return found->second;
    if (senders_.size() == kMostSensors) return std::nullopt;
    senders_.push_back(sender);
    sweeps_.emplace_back();
    azimuths_.push_back(0);
    return topics_[sender] = static_cast<std::uint32_t>(senders_.size() - 1);
  }

  void add(std::uint32_t topic, const CapturedPacket& captured, std::uint32_t azimuth) {
    std::vector<Sweep>& sweeps = sweeps_[topic];
    const std::uint32_t before = std::exchange(azimuths_[topic], azimuth);
    const auto is_new = [&] {
      const Sweep& last = sweeps.back();
      const std::int64_t since_ns = captured.stamp_ns - last.stamp_ns;
      return azimuth + kMostBack < before || since_ns > kLongestSweepNs ||
             since_ns < -kLongestSweepNs || last.packets == kMostPackets;
    };
    if (sweeps.empty() || is_new())
      sweeps.push_back({captured.offset, captured.stamp_ns, 0, topic});
    ++sweeps.back().packets;
  }

  std::vector<Sender>& senders_;
  std::map<Sender, std::uint32_t> topics_;
  std::vector<std::vector<Sweep>> sweeps_;
  /// Of each sensor's last packet.
  std::vector<std::uint32_t> azimuths_;
  std::size_t packets_ = 0;
  std::size_t fragments_ = 0;
  std::size_t cut_ = 0;
  std::size_t of_others_ = 0;
  std::set<std::uint32_t> links_;
};

PcapBag::PcapBag(const std::filesystem::path& file, const std::filesystem::path& shown_as)
    : capture_(file, shown_as) {
  Index index(senders_);
  const std::string why = capture_.visit_all([&](const CapturedPacket& packet) {
    index.take(packet);
    return true;
  });
  if (!why.empty()) damage_.add(why);
  const std::string left_out = index.left_out();
  if (senders_.empty())
    throw InputError(
        this->file().string(),
        fmt::format("no data of a Velodyne in {} packets{}{}", index.packets(),
                    left_out.empty() ? "" : ": ", left_out) +
            (why.empty() ? "" : "; not readable " + why),
        "UDP over IPv4 with 1206 bytes, captured with Ethernet's, Linux' or no header: "
        "record the port of the sensor's data, or a bag of the clouds that its driver "
        "makes");
  for (const Sender& sender : senders_)
    topics_.push_back({address_text(sender.source, sender.port), std::string(kVelodyneScan),
                       Serialization::kRos1});
  add_note("stamps are those of the capture: the clock of the computer that recorded it");
  if (!left_out.empty()) add_note("not read: " + left_out);
  set_sweeps(std::move(index).sweeps());
}

void PcapBag::set_sweeps(std::vector<std::vector<Sweep>> by_topic) {
  std::size_t parts = 0;
  for (std::vector<Sweep>& sweeps : by_topic) {
    const auto is_part = [](const Sweep& end, const Sweep& next) {
      return 2 * end.packets < next.packets;
    };
    auto begin = sweeps.begin();
    auto end = sweeps.end();
    if (end - begin > 1 && is_part(*begin, *(begin + 1))) ++begin, ++parts;
    if (end - begin > 1 && is_part(*(end - 1), *(end - 2))) --end, ++parts;
    sweeps_.insert(sweeps_.end(), begin, end);
  }
  std::ranges::sort(sweeps_, {}, &Sweep::offset);
  if (parts > 0)
    add_note(fmt::format("{} sweeps left out, in which the capture began or ended", parts));
}

std::vector<std::byte> PcapBag::head_of(const Sweep& sweep) const {
  const std::string& frame = topics_[sweep.topic].name;
  std::vector<std::byte> message;
  append_number(message, std::uint32_t{0});  // the number in the sequence
  append_stamp(message, sweep.stamp_ns);
  append_number(message, static_cast<std::uint32_t>(frame.size()));
  for (const char letter : frame) message.push_back(static_cast<std::byte>(letter));
  append_number(message, sweep.packets);
  return message;
}

std::size_t PcapBag::size_of(const Sweep& sweep) const {
  return 4 + 8 + 4 + topics_[sweep.topic].name.size() + 4 + kPacketOfMessage * sweep.packets;
}

BagDamage PcapBag::visit(std::span<const std::size_t> head_bytes, const Take& take) const {
  for (std::size_t i = 0; i < sweeps_.size(); ++i) {
    const Sweep& sweep = sweeps_[i];
    const std::size_t wanted = head_bytes[sweep.topic];
    if (wanted == 0) continue;
    const std::vector<std::byte> head = head_of(sweep);
    take({sweep.topic,
          {sweep.offset, i, static_cast<std::uint32_t>(size_of(sweep))},
          sweep.stamp_ns,
          std::span(head).first(std::min(wanted, head.size()))});
  }
  return damage_;
}

FileBytes PcapBag::read(const MessagePlace& place) const {
  const Sweep& sweep = sweeps_.at(place.inner);
  const Sender& sender = senders_[sweep.topic];
  std::vector<std::byte> message = head_of(sweep);
  message.reserve(size_of(sweep));
  capture_.visit_from(sweep.offset, [&](const CapturedPacket& captured) {
    const UdpPacket packet = read_udp(captured);
    if (packet.kind == UdpPacket::Kind::kWhole && is_data(packet.payload) &&
        Sender{packet.source, packet.port} == sender) {
      append_stamp(message, captured.stamp_ns);
      message.insert(message.end(), packet.payload.begin(), packet.payload.end());
    }
    return message.size() < size_of(sweep);
  });
  if (message.size() < size_of(sweep))
    throw InputError(file().string(),
                     fmt::format("{} bytes of a sweep at byte {}", message.size(), sweep.offset),
                     fmt::format("{}; the capture changed or was cut off while it was read: copy "
                                 "it again",
                                 size_of(sweep)));
  auto bytes = std::make_unique_for_overwrite<std::byte[]>(message.size());
  std::memcpy(bytes.get(), message.data(), message.size());
  return {std::move(bytes), message.size()};
}

}  // namespace stillmap::maps::pcap
