#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "bags/byte_stream.hpp"
#include "formats/file_reader.hpp"
#include "packets/packet_bytes.hpp"

namespace stillmap::maps::pcap {

/// Whether a file that begins so is a capture: pcap, in both byte orders with microseconds or
/// nanoseconds, or pcapng.
[[nodiscard]] bool is_capture(std::span<const std::byte> first_bytes);

/// A packet as it was captured.
struct CapturedPacket {
  /// Of its record in the file.
  std::uint64_t offset = 0;
  /// Since the epoch, below 2^32 s.
  std::int64_t stamp_ns = 0;
  /// Which header the packet begins with: LINKTYPE_ of https://www.tcpdump.org/linktypes.html.
  std::uint32_t link = 0;
  /// Valid until the next packet.
  std::span<const std::byte> bytes;
};

/// A file of captured packets, as tcpdump and Wireshark write it: pcap
/// (draft-ietf-opsawg-pcap) or pcapng (draft-ietf-opsawg-pcapng: section header, interface
/// description and enhanced packet blocks; others are skipped).
class CaptureFile {
 public:
  /// @param shown_as  what it is called, where that is another.
  /// @throws InputError for a file that does not begin as one; StorageError.
  CaptureFile(const std::filesystem::path& file, const std::filesystem::path& shown_as);

  [[nodiscard]] const std::filesystem::path& file() const { return reader_.file(); }

  /// @return whether to go on.
  using Take = std::function<bool(const CapturedPacket&)>;
  /// Hands on all packets in the order of the file, as far as it can be read. To be called once,
  /// before `visit_from`.
  /// @return why it could not be read to its end; empty where it could. @throws StorageError.
  std::string visit_all(const Take& take);
  /// From a packet on. Safe from several threads. @param offset  of a visited one.
  void visit_from(std::uint64_t offset, const Take& take) const;

 private:
  /// Of pcapng; pcap has one.
  struct Interface {
    std::uint32_t link = 0;
    /// A second has `ticks_per_s`, after a division of the stamp by `divisor`.
    std::uint64_t ticks_per_s = 1'000'000;
    std::uint64_t divisor = 1;
    std::int64_t offset_s = 0;
  };
  /// A part of a pcapng with a byte order and interfaces of its own; a pcap is one.
  struct Section {
    std::uint64_t begin = 0;
    bool big_endian = false;
    std::vector<Interface> interfaces;
  };
  class Walk;

  [[nodiscard]] static Interface interface_of(std::span<const std::byte> block, bool big_endian);
  [[nodiscard]] static std::int64_t stamp_of(std::uint64_t ticks, const Interface& from);

  FileReader reader_;
  bool is_ng_ = false;
  std::vector<Section> sections_;
};

}  // namespace stillmap::maps::pcap
