#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "bags/chunk.hpp"

namespace stillmap::maps::mcap {

/// The records of MCAP (https://mcap.dev/spec) that are looked into; others are stepped over.
enum class Op : std::uint8_t {
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kChunkIndex = 0x08,
  kStatistics = 0x0B,
  kDataEnd = 0x0F,
};

inline constexpr std::array<std::uint8_t, 8> kMagic{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
/// Opcode and length.
inline constexpr std::uint64_t kHeadBytes = 9;
inline constexpr std::uint64_t kFooterBytes = kHeadBytes + 20;

/// The content of one record, read in the order of its fields (little endian); what is asked for
/// beyond its length or the end of the stream makes it short, and then all values are zeros.
class Record {
 public:
  /// @param stream  outlives this, and is at the record's content.
  Record(ByteStream& stream, std::uint64_t length) : stream_(&stream), left_(length) {}

  template <typename Number>
  Number number() {
    std::array<std::byte, sizeof(Number)> raw{};
    take(raw);
    Number value;
    std::memcpy(&value, raw.data(), raw.size());
    return value;
  }
  /// @param most  bytes; a longer text makes the record short.
  std::string text(std::size_t most);
  /// As many bytes as there are of these.
  void bytes(std::span<std::byte> into) { take(into); }
  void skip(std::uint64_t bytes);
  /// To the record's end. @return whether all of it was there.
  bool finish();
  [[nodiscard]] bool is_short() const { return short_; }
  /// What was not read yet.
  [[nodiscard]] std::uint64_t left() const { return left_; }

 private:
  void take(std::span<std::byte> into);

  ByteStream* stream_;
  std::uint64_t left_;
  bool short_ = false;
};

struct RecordHead {
  Op op{};
  std::uint64_t length = 0;
};
/// @return nothing at the end of the stream, also where a head is cut off.
[[nodiscard]] std::optional<RecordHead> next_record(ByteStream& stream);

struct Channel {
  std::uint16_t schema = 0;
  std::string topic;
  std::string encoding;
};

/// Channels and the names of their schemas as they come by; the first of an id counts.
struct Channels {
  std::map<std::uint16_t, std::string> schemas;
  std::map<std::uint16_t, Channel> channels;

  /// A record of these two kinds. @return false when it is cut off or there are too many.
  bool take(Op op, Record& record);
};

/// A chunk by its record, whose content is at `offset` and reaches `length` far or to the file's
/// end. @param name  for messages.
/// @throws InputError for a head that is cut off, and as `Chunk`.
[[nodiscard]] std::unique_ptr<Chunk> open_chunk(const FileReader& file, std::uint64_t offset,
                                                std::uint64_t length, const std::string& name);

struct ChunkIndex {
  std::uint64_t offset = 0;
  /// Of the whole record.
  std::uint64_t length = 0;
  /// Bit `id % 64` of each channel with messages in it; all where it is not told.
  std::uint64_t channels = 0;
};
/// @return nothing when it is cut off.
[[nodiscard]] std::optional<ChunkIndex> read_chunk_index(Record& record);

/// What the file holds in all.
struct Statistics {
  std::uint32_t channels = 0;
  std::uint32_t chunks = 0;
};
/// @return nothing when it is cut off.
[[nodiscard]] std::optional<Statistics> read_statistics(Record& record);

/// Messages' fields before their data.
struct MessageHead {
  static constexpr std::uint64_t kBytes = 2 + 4 + 8 + 8;
  std::uint16_t channel = 0;
  std::uint64_t log_time_ns = 0;
};
[[nodiscard]] MessageHead read_message_head(Record& record);

}  // namespace stillmap::maps::mcap
