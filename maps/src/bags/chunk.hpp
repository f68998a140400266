#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "bags/byte_stream.hpp"

namespace stillmap::maps {

/// What a bag says of one of its chunks.
struct ChunkHead {
  std::uint64_t unpacked_bytes = 0;
  /// CRC-32 of the unpacked bytes; 0 = not told.
  std::uint32_t crc = 0;
  /// As `unpacked` takes it; empty = not packed.
  std::string compression;
  std::uint64_t packed_bytes = 0;
};

/// The records of one chunk, unpacked as they are read; never more of them than its head says.
class Chunk final : public ByteStream {
 public:
  /// @param file            outlives this.
  /// @param records_offset  where its bytes begin; they reach to the file's end at most.
  /// @param name            for messages.
  /// @throws InputError for another compression, or a head that claims more than a recorder packs;
  /// StorageError.
  Chunk(const FileReader& file, ChunkHead head, std::uint64_t records_offset,
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

/// Packed chunks that were read halfway, of which the next message will likely be asked for. Safe
/// from several threads.
class OpenChunks {
 public:
  /// @return one of this offset that has not come by `position` yet, or null.
  [[nodiscard]] std::unique_ptr<Chunk> take(std::uint64_t offset, std::uint64_t position);
  /// Keeps a chunk that has more to give; of several the latest ones stay.
  void give(std::uint64_t offset, std::unique_ptr<Chunk> chunk);

 private:
  struct Open {
    std::uint64_t offset = 0;
    std::unique_ptr<Chunk> chunk;
  };
  std::mutex mutex_;
  std::vector<Open> open_;
};

/// How much all chunks of a file unpack to, so that bytes made to cost time end.
class UnpackedCount {
 public:
  explicit UnpackedCount(std::uint64_t file_bytes) : file_bytes_(file_bytes) {}
  /// @throws InputError where the chunks so far grow without measure.
  void add(const Chunk& chunk);

 private:
  std::uint64_t file_bytes_;
  std::uint64_t unpacked_bytes_ = 0;
};

}  // namespace stillmap::maps
