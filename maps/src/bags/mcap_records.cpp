#include "bags/mcap_records.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <utility>

namespace stillmap::maps::mcap {
namespace {

constexpr std::size_t kMostNameBytes = 1024;
// Together with the bound on names, some megabytes.
constexpr std::size_t kMostChannels = 4096;

}  // namespace

void Record::take(std::span<std::byte> into) {
  const std::size_t wanted = short_ ? 0 : into.size();
  std::size_t got = 0;
  if (wanted <= left_) {
    got = stream_->read(into.first(wanted));
    left_ -= got;
  }
  if (got == into.size()) return;
  short_ = true;
  std::fill(into.begin(), into.end(), std::byte{0});
}

std::string Record::text(std::size_t most) {
  const auto length = number<std::uint32_t>();
  if (length > most || length > left_) short_ = true;
  if (short_) return {};
  std::string text(length, '\0');
  take(std::as_writable_bytes(std::span(text)));
  return short_ ? std::string() : text;
}

void Record::skip(std::uint64_t bytes) {
  if (short_ || bytes > left_) {
    short_ = true;
    return;
  }
  const std::uint64_t skipped = stream_->skip(bytes);
  left_ -= skipped;
  short_ = skipped < bytes;
}

bool Record::finish() {
  const std::uint64_t skipped = stream_->skip(left_);
  short_ = short_ || skipped < left_;
  left_ -= skipped;
  return !short_;
}

std::optional<RecordHead> next_record(ByteStream& stream) {
  Record record(stream, kHeadBytes);
  RecordHead head;
  head.op = static_cast<Op>(record.number<std::uint8_t>());
  head.length = record.number<std::uint64_t>();
  if (record.is_short()) return std::nullopt;
  return head;
}

bool Channels::take(Op op, Record& record) {
  const auto id = record.number<std::uint16_t>();
  if (op == Op::kSchema) {
    std::string name = record.text(kMostNameBytes);
    if (record.is_short() || schemas.size() >= kMostChannels) return false;
    if (id != 0) schemas.emplace(id, std::move(name));
    return true;
  }
  Channel channel;
  channel.schema = record.number<std::uint16_t>();
  channel.topic = record.text(kMostNameBytes);
  channel.encoding = record.text(kMostNameBytes);
  if (record.is_short() || channels.size() >= kMostChannels) return false;
  channels.emplace(id, std::move(channel));
  return true;
}

std::unique_ptr<Chunk> open_chunk(const FileReader& file, std::uint64_t offset,
                                  std::uint64_t length, const std::string& name) {
  constexpr std::size_t kMostCompressionBytes = 32;
  const std::uint64_t end = offset + std::min(length, file.size() - std::min(offset, file.size()));
  FileStream stream(file, offset, end);
  Record record(stream, length);
  ChunkHead head;
  record.skip(8 + 8);  // times of its first and last message
  head.unpacked_bytes = record.number<std::uint64_t>();
  head.crc = record.number<std::uint32_t>();
  head.compression = record.text(kMostCompressionBytes);
  head.packed_bytes = record.number<std::uint64_t>();
  if (record.is_short() || head.packed_bytes > record.left())
    throw InputError(name, "a chunk whose head is cut off", "a whole one");
  return std::make_unique<Chunk>(file, std::move(head), stream.position(), name);
}

std::optional<ChunkIndex> read_chunk_index(Record& record) {
  ChunkIndex index;
  record.skip(8 + 8);
  index.offset = record.number<std::uint64_t>();
  index.length = record.number<std::uint64_t>();
  constexpr std::uint32_t kEntryBytes = 2 + 8;
  const auto entries = record.number<std::uint32_t>();
  if (entries > record.left()) return std::nullopt;
  for (std::uint32_t i = 0; i < entries / kEntryBytes && !record.is_short(); ++i) {
    index.channels |= std::uint64_t{1} << record.number<std::uint16_t>() % 64U;
    record.skip(8);
  }
  if (entries == 0) index.channels = ~std::uint64_t{0};
  if (record.is_short()) return std::nullopt;
  return index;
}

std::optional<Statistics> read_statistics(Record& record) {
  Statistics statistics;
  record.skip(8 + 2);  // messages and schemas
  statistics.channels = record.number<std::uint32_t>();
  record.skip(4 + 4);  // attachments and metadata
  statistics.chunks = record.number<std::uint32_t>();
  if (record.is_short()) return std::nullopt;
  return statistics;
}

MessageHead read_message_head(Record& record) {
  MessageHead head;
  head.channel = record.number<std::uint16_t>();
  record.skip(4);
  head.log_time_ns = record.number<std::uint64_t>();
  record.skip(8);
  return head;
}

}  // namespace stillmap::maps::mcap
