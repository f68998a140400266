#pragma once

#include <memory>
#include <string>

#include "bags/mcap_records.hpp"

namespace stillmap::maps::mcap {

/// The records of one chunk, unpacked as they are read; never more of them than the chunk says.
class Chunk final : public ByteStream {
 public:
  /// @param file  outlives this. @param offset  of the record's content, whose bytes reach
  /// `length` far or to the file's end. @param name  for messages.
  /// @throws InputError for a head that is cut off or another compression; StorageError.
  Chunk(const FileReader& file, std::uint64_t offset, std::uint64_t length,
        const std::string& name);

  std::size_t read(std::span<std::byte> into) override;
  std::uint64_t skip(std::uint64_t bytes) override;

  /// As `skip`, but what is not packed is read as well, for its CRC.
  std::uint64_t read_over(std::uint64_t bytes) { return ByteStream::skip(bytes); }
  [[nodiscard]] std::uint64_t position() const { return position_; }
  [[nodiscard]] const ChunkHead& head() const { return head_; }
  [[nodiscard]] bool is_packed() const { return !head_.compression.empty(); }
  /// Where its records begin in the file, of a chunk that is not packed.
  [[nodiscard]] std::uint64_t records_offset() const { return records_offset_; }

  /// Reads on to the end. @return what is wrong: it is cut off, or its CRC-32 does not fit; empty
  /// when nothing is. The CRC of what is not packed is known only where none of it was skipped.
  [[nodiscard]] std::string finish();

 private:
  void count(std::span<const std::byte> bytes);

  ChunkHead head_;
  std::uint64_t records_offset_ = 0;
  std::unique_ptr<ByteStream> records_;
  std::uint64_t position_ = 0;
  std::uint32_t crc_ = 0;
  bool crc_is_whole_ = true;
};

}  // namespace stillmap::maps::mcap
