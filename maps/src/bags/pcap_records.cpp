#include "bags/pcap_records.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <utility>

namespace stillmap::maps::pcap {
namespace {

constexpr std::uint32_t kMicroseconds = 0xa1b2c3d4;
constexpr std::uint32_t kNanoseconds = 0xa1b23c4d;
constexpr std::size_t kFileHeaderBytes = 24;
constexpr std::uint32_t kSectionHeader = 0x0a0d0d0a;
constexpr std::uint32_t kInterfaceDescription = 1;
constexpr std::uint32_t kEnhancedPacket = 6;
constexpr std::uint32_t kByteOrder = 0x1a2b3c4d;
/// tcpdump's MAXIMUM_SNAPLEN.
constexpr std::uint32_t kMostPacketBytes = 262'144;
/// Of a block with its name, filters and comments.
constexpr std::uint32_t kMostInterfaceBytes = 65'536;
/// Of a file. Each takes memory, and computers have some dozens.
constexpr std::size_t kMostInterfaces = 1000;
constexpr std::int64_t kMostSeconds = 0xffffffff;
constexpr std::uint64_t kNsPerSecond = 1'000'000'000;

std::string at_byte(std::uint64_t offset, const std::string& what) {
  return fmt::format("at byte {}: {}", offset, what);
}

}  // namespace

bool is_capture(std::span<const std::byte> first_bytes) {
  if (first_bytes.size() < 12) return false;
  for (const bool big : {false, true}) {
    const auto magic = integer_at<std::uint32_t>(first_bytes, 0, big);
    if (magic == kMicroseconds || magic == kNanoseconds) return true;
    if (magic == kSectionHeader && integer_at<std::uint32_t>(first_bytes, 8, big) == kByteOrder)
      return true;
  }
  return false;
}

CaptureFile::Interface CaptureFile::interface_of(std::span<const std::byte> block,
                                                 bool big_endian) {
  Interface found;
  found.link = integer_at<std::uint16_t>(block, 0, big_endian);
  // Options: code, length and value, filled up to 4 bytes.
  constexpr std::uint16_t kResolution = 9;
  constexpr std::uint16_t kOffset = 14;
  for (std::size_t at = 8; at + 4 <= block.size();) {
    const auto code = integer_at<std::uint16_t>(block, at, big_endian);
    const std::size_t size = integer_at<std::uint16_t>(block, at + 2, big_endian);
    if (code == 0 || size > block.size() - at - 4) break;
    if (code == kOffset && size == 8)
      found.offset_s = integer_at<std::int64_t>(block, at + 4, big_endian);
    if (code == kResolution && size == 1) {
      const auto value = std::to_integer<unsigned>(block[at + 4]);
      const unsigned digits = value & 0x7fU;
      const bool is_binary = (value & 0x80U) != 0;
      found.ticks_per_s = found.divisor = 1;
      for (unsigned i = 0; i < digits; ++i) {
        const std::uint64_t base = is_binary ? 2 : 10;
        // Finer ones than 2^-32 s or 10^-9 s are cut off; 2^63 or 10^19 of them are no second.
        if (i < (is_binary ? 32U : 9U))
          found.ticks_per_s *= base;
        else if (found.divisor < std::uint64_t{1} << 60U)
          found.divisor *= base;
      }
    }
    at += 4 + (size + 3) / 4 * 4;
  }
  return found;
}

std::int64_t CaptureFile::stamp_of(std::uint64_t ticks, const Interface& from) {
  ticks /= from.divisor;
  const std::uint64_t whole_s =
      std::min(ticks / from.ticks_per_s, static_cast<std::uint64_t>(kMostSeconds));
  const std::int64_t offset_s = std::clamp(from.offset_s, -kMostSeconds, kMostSeconds);
  const std::int64_t s =
      std::clamp(static_cast<std::int64_t>(whole_s) + offset_s, std::int64_t{0}, kMostSeconds);
  return s * static_cast<std::int64_t>(kNsPerSecond) +
         static_cast<std::int64_t>(ticks % from.ticks_per_s * kNsPerSecond / from.ticks_per_s);
}

/// Goes through the records of a file.
class CaptureFile::Walk {
 public:
  /// @param begin  of a record. @param section  that it lies in.
  Walk(const CaptureFile& capture, std::uint64_t begin, Section section, const Take& take)
      : stream_(capture.reader_, begin, capture.reader_.size()),
        end_(capture.reader_.size()),
        section_(std::move(section)),
        take_(take) {}

  /// @return why not to the end, or empty.
  std::string pcap() {
    while (next_pcap()) {
    }
    return why_;
  }
  /// @param sections  to be filled with what comes by, or null.
  std::string pcapng(std::vector<Section>* sections) {
    while (next_block(sections)) {
    }
    return why_;
  }

 private:
  bool end(const std::string& why) {
    why_ = at_byte(begin_, why);
    return false;
  }
  bool cut() { return end("the file ends within a record"); }
  [[nodiscard]] std::uint32_t u32(std::size_t at) const {
    return integer_at<std::uint32_t>(head_, at, section_.big_endian);
  }

  bool next_pcap() {
    begin_ = stream_.position();
    if (begin_ >= end_) return false;
    const Interface& from = section_.interfaces.front();
    if (stream_.read(head_) < head_.size()) return cut();
    const std::uint64_t ticks = u32(0) * from.ticks_per_s + u32(4);
    return packet(u32(8), ticks, from);
  }

  bool packet(std::uint32_t size, std::uint64_t ticks, const Interface& from) {
    if (size > kMostPacketBytes) return end(fmt::format("a packet of {} bytes", size));
    bytes_.resize(size);
    if (stream_.read(bytes_) < size) return cut();
    return take_({begin_, stamp_of(ticks, from), from.link, bytes_});
  }

  bool next_block(std::vector<Section>* sections) {
    begin_ = stream_.position();
    if (begin_ >= end_) return false;
    const std::span<std::byte> head = std::span(head_).first(12);
    if (stream_.read(head) < head.size()) return cut();
    // Type, length, and the first number of the body.
    if (u32(0) == kSectionHeader && !begin_section(sections)) return false;
    const std::uint32_t size = u32(4);
    if (size < 12 || size % 4 != 0) return end(fmt::format("a block of {} bytes", size));
    const std::uint64_t next = begin_ + size;
    if (u32(0) == kInterfaceDescription && !add_interface(size, sections)) return false;
    if (u32(0) == kEnhancedPacket && !enhanced_packet(size)) return false;
    const std::uint64_t left = next - stream_.position();
    return stream_.skip(left) == left || cut();
  }

  bool begin_section(std::vector<Section>* sections) {
    section_ = {begin_, integer_at<std::uint32_t>(head_, 8, true) == kByteOrder, {}};
    if (u32(8) != kByteOrder) return end("a section without its byte order");
    if (sections != nullptr) sections->push_back(section_);
    return true;
  }

  bool add_interface(std::uint32_t size, std::vector<Section>* sections) {
    if (size < 20 || size > kMostInterfaceBytes)
      return end(fmt::format("an interface of {} bytes", size));
    std::vector<std::byte> block(size - 12);
    std::copy_n(head_.begin() + 8, 4, block.begin());
    if (stream_.read(std::span(block).subspan(4)) < block.size() - 4) return cut();
    section_.interfaces.push_back(interface_of(block, section_.big_endian));
    if (sections == nullptr) return true;
    if (sections->empty()) return end("an interface before any section");
    sections->back().interfaces.push_back(section_.interfaces.back());
    if (++interfaces_ > kMostInterfaces)
      return end(fmt::format("more than {} interfaces", kMostInterfaces));
    return true;
  }

  bool enhanced_packet(std::uint32_t size) {
    constexpr std::uint32_t kAroundPacket = 32;
    if (size < kAroundPacket) return end(fmt::format("a packet's block of {} bytes", size));
    const std::uint32_t number = u32(8);
    std::array<std::byte, 16> fields;
    if (stream_.read(fields) < fields.size()) return cut();
    const auto field = [&](std::size_t at) {
      return std::uint64_t{integer_at<std::uint32_t>(fields, at, section_.big_endian)};
    };
    if (number >= section_.interfaces.size())
      return end(fmt::format("a packet of interface {} of {}", number, section_.interfaces.size()));
    if (field(8) > size - kAroundPacket)
      return end(fmt::format("a packet of {} bytes in a block of {}", field(8), size));
    return packet(static_cast<std::uint32_t>(field(8)), field(0) << 32U | field(4),
                  section_.interfaces[number]);
  }

  FileStream stream_;
  std::uint64_t end_;
  Section section_;
  const Take& take_;
  /// Of the record that is being read.
  std::uint64_t begin_ = 0;
  std::array<std::byte, 16> head_{};
  std::vector<std::byte> bytes_;
  std::size_t interfaces_ = 0;
  std::string why_;
};

CaptureFile::CaptureFile(const std::filesystem::path& file, const std::filesystem::path& shown_as)
    : reader_(file, shown_as) {
  std::array<std::byte, kFileHeaderBytes> head{};
  const std::size_t size = reader_.read_at(0, head);
  if (!is_capture(std::span(head).first(size)))
    throw InputError(reader_.file().string(), "no capture by its first bytes",
                     "pcap or pcapng: record or copy it again");
  is_ng_ = integer_at<std::uint32_t>(head, 0, false) == kSectionHeader;
  if (is_ng_) return;
  if (size < head.size())
    throw InputError(reader_.file().string(), fmt::format("{} bytes", size),
                     "a whole capture: record or copy it again");
  const auto magic_of = [&](bool big) { return integer_at<std::uint32_t>(head, 0, big); };
  Section section;
  section.big_endian = magic_of(true) == kMicroseconds || magic_of(true) == kNanoseconds;
  Interface from;
  // What stands above it says how many bytes of a checksum follow.
  from.link = integer_at<std::uint32_t>(head, 20, section.big_endian) & 0x0fffffffU;
  from.ticks_per_s = magic_of(section.big_endian) == kNanoseconds ? kNsPerSecond : 1'000'000;
  section.interfaces.push_back(from);
  sections_.push_back(std::move(section));
}

std::string CaptureFile::visit_all(const Take& take) {
  if (is_ng_) return Walk(*this, 0, {}, take).pcapng(&sections_);
  return Walk(*this, kFileHeaderBytes, sections_.front(), take).pcap();
}

void CaptureFile::visit_from(std::uint64_t offset, const Take& take) const {
  const auto after = std::ranges::upper_bound(sections_, offset, {}, &Section::begin);
  if (after == sections_.begin()) return;
  Walk walk(*this, offset, *std::prev(after), take);
  is_ng_ ? walk.pcapng(nullptr) : walk.pcap();
}

}  // namespace stillmap::maps::pcap
