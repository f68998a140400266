#include "bags/mcap_chunk.hpp"

#include <zlib.h>

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>

namespace stillmap::maps::mcap {
namespace {

/// Nothing a sensor sends is packed so well, but bytes made to cost time are.
constexpr std::uint64_t kMostChunkRatio = 1000;
constexpr std::uint64_t kAlwaysUnpackedBytes = std::uint64_t{16} << 20U;

}  // namespace

Chunk::Chunk(const FileReader& file, std::uint64_t offset, std::uint64_t length,
             const std::string& name) {
  const std::uint64_t end = offset + std::min(length, file.size() - std::min(offset, file.size()));
  FileStream stream(file, offset, end);
  Record record(stream, length);
  const std::optional<ChunkHead> head = read_chunk_head(record);
  if (!head || head->packed_bytes > record.left())
    throw InputError(name, "a chunk whose head is cut off", "a whole one");
  head_ = *head;
  if (head_.unpacked_bytes > kAlwaysUnpackedBytes &&
      head_.unpacked_bytes / kMostChunkRatio > head_.packed_bytes)
    throw InputError(
        name, fmt::format("a chunk of {} bytes in {}", head_.unpacked_bytes, head_.packed_bytes),
        fmt::format("at most {} times as many", kMostChunkRatio));
  records_offset_ = stream.position();
  const std::uint64_t records_end = std::min(end, records_offset_ + head_.packed_bytes);
  auto packed = std::make_unique<FileStream>(file, records_offset_, records_end);
  records_ = is_packed() ? unpacked(std::move(packed), head_.compression, name) : std::move(packed);
}

void Chunk::count(std::span<const std::byte> bytes) {
  position_ += bytes.size();
  if (head_.crc != 0)
    crc_ = static_cast<std::uint32_t>(
        ::crc32_z(crc_, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

std::size_t Chunk::read(std::span<std::byte> into) {
  into = into.first(static_cast<std::size_t>(
      std::min<std::uint64_t>(into.size(), head_.unpacked_bytes - position_)));
  const std::size_t got = records_->read(into);
  count(into.first(got));
  return got;
}

std::uint64_t Chunk::skip(std::uint64_t bytes) {
  bytes = std::min(bytes, head_.unpacked_bytes - position_);
  if (is_packed()) return ByteStream::skip(bytes);
  crc_is_whole_ = crc_is_whole_ && bytes == 0;
  const std::uint64_t skipped = records_->skip(bytes);
  position_ += skipped;
  return skipped;
}

std::string Chunk::finish() {
  (void)skip(head_.unpacked_bytes - position_);
  if (position_ < head_.unpacked_bytes)
    return fmt::format("cut off after {} of {} bytes", position_, head_.unpacked_bytes);
  if (head_.crc != 0 && crc_is_whole_ && crc_ != head_.crc)
    return fmt::format("CRC-32 {:08x}, expected {:08x}", crc_, head_.crc);
  return {};
}

}  // namespace stillmap::maps::mcap
