#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "bags/chunk.hpp"

namespace stillmap::maps::ros1 {

/// The records of ROS 1's bag format 2.0 (https://wiki.ros.org/Bags/Format/2.0) that are looked
/// into; others are stepped over.
enum class Op : std::uint8_t {
  kMessage = 0x02,
  kBagHeader = 0x03,
  kIndexData = 0x04,
  kChunk = 0x05,
  kChunkInfo = 0x06,
  kConnection = 0x07,
};

inline constexpr std::string_view kMagic = "#ROSBAG V2.0\n";

/// Fields `name=value` of a record's header, or of a connection's data.
class Fields {
 public:
  /// @return nothing where a length goes beyond the bytes or a field has no name.
  [[nodiscard]] static std::optional<Fields> parse(std::span<const std::byte> bytes);

  /// Little endian. @return nothing where there is none of this size.
  template <typename Number>
  [[nodiscard]] std::optional<Number> number(std::string_view name) const {
    const auto found = values_.find(name);
    if (found == values_.end() || found->second.size() != sizeof(Number)) return std::nullopt;
    Number value;
    std::memcpy(&value, found->second.data(), sizeof(Number));
    return value;
  }
  /// Empty where there is none.
  [[nodiscard]] std::string text(std::string_view name) const;

 private:
  std::map<std::string, std::string, std::less<>> values_;
};

/// A record up to its data.
struct RecordHead {
  Op op{};
  Fields fields;
  std::uint32_t data_bytes = 0;
};

/// Reads up to the data of the next record.
/// @return nothing at the end of the stream, also where a head is cut off.
/// @throws InputError for a head that is none, or longer than any recorder writes.
[[nodiscard]] std::optional<RecordHead> next_record(ByteStream& stream);

struct Connection {
  std::string topic;
  /// "sensor_msgs/PointCloud2".
  std::string type;
};

/// Connections as they come by; the first of an id counts.
struct Connections {
  std::map<std::uint32_t, Connection> by_id;

  /// A record of this kind, with the stream at its data, of which as much as it needs is read.
  /// @return false where it is cut off or broken, or where there are too many.
  bool take(const RecordHead& head, ByteStream& stream);
};

/// A chunk by the head of its record, with its data at `data_offset`.
/// @throws InputError for a head without the fields of a chunk, and as `Chunk`.
[[nodiscard]] std::unique_ptr<Chunk> open_chunk(const FileReader& file, const RecordHead& head,
                                                std::uint64_t data_offset, const std::string& name);

/// What the end of an indexed bag says of a chunk.
struct ChunkInfo {
  /// Of its record in the file.
  std::uint64_t offset = 0;
  /// Bit `id % 64` of each connection with messages in it.
  std::uint64_t connections = 0;
};
/// With the stream at the record's data. @return nothing where it is cut off or broken.
[[nodiscard]] std::optional<ChunkInfo> read_chunk_info(const RecordHead& head, ByteStream& stream);

}  // namespace stillmap::maps::ros1
