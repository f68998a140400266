#include "bags/ros1_records.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

namespace stillmap::maps::ros1 {
namespace {

/// A header holds a topic and some numbers.
constexpr std::size_t kMostHeaderBytes = std::size_t{64} << 10U;
/// A connection's data hold the definition of its messages with all that these contain.
constexpr std::size_t kMostConnectionBytes = std::size_t{4} << 20U;
constexpr std::size_t kMostConnections = 4096;
constexpr std::size_t kMostNameBytes = 1024;

std::optional<std::uint32_t> read_length(ByteStream& stream) {
  std::uint32_t length = 0;
  if (stream.read(std::as_writable_bytes(std::span(&length, 1))) != sizeof(length))
    return std::nullopt;
  return length;
}

std::optional<std::vector<std::byte>> read_bytes(ByteStream& stream, std::size_t size) {
  std::vector<std::byte> bytes(size);
  if (stream.read(bytes) != size) return std::nullopt;
  return bytes;
}

}  // namespace

std::optional<Fields> Fields::parse(std::span<const std::byte> bytes) {
  Fields fields;
  while (!bytes.empty()) {
    std::uint32_t length = 0;
    if (bytes.size() < sizeof(length)) return std::nullopt;
    std::memcpy(&length, bytes.data(), sizeof(length));
    bytes = bytes.subspan(sizeof(length));
    if (length > bytes.size()) return std::nullopt;
    const std::string_view field(reinterpret_cast<const char*>(bytes.data()), length);
    bytes = bytes.subspan(length);
    const std::size_t equals = field.find('=');
    if (equals == std::string_view::npos || equals == 0) return std::nullopt;
    fields.values_.emplace(field.substr(0, equals), field.substr(equals + 1));
  }
  return fields;
}

std::string Fields::text(std::string_view name) const {
  const auto found = values_.find(name);
  return found == values_.end() ? std::string() : found->second;
}

std::optional<RecordHead> next_record(ByteStream& stream) {
  const std::optional<std::uint32_t> length = read_length(stream);
  if (!length) return std::nullopt;
  if (*length > kMostHeaderBytes)
    throw InputError("record", fmt::format("a header of {} bytes", *length),
                     fmt::format("at most {}", kMostHeaderBytes));
  const auto bytes = read_bytes(stream, *length);
  if (!bytes) return std::nullopt;
  const std::optional<std::uint32_t> data_bytes = read_length(stream);
  if (!data_bytes) return std::nullopt;
  std::optional<Fields> fields = Fields::parse(*bytes);
  const auto op = fields ? fields->number<std::uint8_t>("op") : std::nullopt;
  if (!op) throw InputError("record", "a header without fields that can be read", "op=...");
  return RecordHead{static_cast<Op>(*op), std::move(*fields), *data_bytes};
}

bool Connections::take(const RecordHead& head, ByteStream& stream) {
  const auto id = head.fields.number<std::uint32_t>("conn");
  std::string topic = head.fields.text("topic");
  if (!id || topic.empty() || topic.size() > kMostNameBytes ||
      head.data_bytes > kMostConnectionBytes || by_id.size() >= kMostConnections)
    return false;
  const auto bytes = read_bytes(stream, head.data_bytes);
  const std::optional<Fields> fields = bytes ? Fields::parse(*bytes) : std::nullopt;
  if (!fields) return false;
  std::string type = fields->text("type");
  if (type.size() > kMostNameBytes) return false;
  by_id.emplace(*id, Connection{std::move(topic), std::move(type)});
  return true;
}

std::unique_ptr<Chunk> open_chunk(const FileReader& file, const RecordHead& head,
                                  std::uint64_t data_offset, const std::string& name) {
  const auto unpacked_bytes = head.fields.number<std::uint32_t>("size");
  const std::string compression = head.fields.text("compression");
  if (!unpacked_bytes || compression.empty())
    throw InputError(name, "a chunk that does not say its size or compression", "both");
  ChunkHead chunk{.unpacked_bytes = *unpacked_bytes,
                  .compression = compression == "none" ? std::string() : compression,
                  .packed_bytes = head.data_bytes};
  return std::make_unique<Chunk>(file, std::move(chunk), data_offset, name);
}

std::optional<ChunkInfo> read_chunk_info(const RecordHead& head, ByteStream& stream) {
  const auto offset = head.fields.number<std::uint64_t>("chunk_pos");
  const auto count = head.fields.number<std::uint32_t>("count");
  // A number of a connection, and how many messages of it.
  constexpr std::uint32_t kEntryBytes = 4 + 4;
  if (!offset || !count || *count > kMostConnections || head.data_bytes != *count * kEntryBytes)
    return std::nullopt;
  ChunkInfo info{.offset = *offset};
  for (std::uint32_t i = 0; i < *count; ++i) {
    std::array<std::uint32_t, 2> entry{};
    if (stream.read(std::as_writable_bytes(std::span(entry))) != kEntryBytes) return std::nullopt;
    if (entry[1] > 0) info.connections |= std::uint64_t{1} << entry[0] % 64U;
  }
  return info;
}

}  // namespace stillmap::maps::ros1
