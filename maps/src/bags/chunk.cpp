#include "bags/chunk.hpp"

#include <zlib.h>

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace stillmap::maps {
namespace {

/// Nothing a sensor sends is packed so well, but bytes made to cost time are.
constexpr std::uint64_t kMostChunkRatio = 1000;
constexpr std::uint64_t kAlwaysUnpackedBytes = std::uint64_t{16} << 20U;
/// All chunks of a file together; clouds are packed 2 to 5 times.
constexpr std::uint64_t kMostFileRatio = 250;
constexpr std::uint64_t kAlwaysUnpackedOfFile = std::uint64_t{64} << 20U;
/// Chunks that stay open, one for each of some threads that read scans.
constexpr std::size_t kMostOpen = 4;

}  // namespace

Chunk::Chunk(const FileReader& file, ChunkHead head, std::uint64_t records_offset,
             const std::string& name)
    : head_(std::move(head)), records_offset_(records_offset) {
  if (head_.unpacked_bytes > kAlwaysUnpackedBytes &&
      head_.unpacked_bytes / kMostChunkRatio > head_.packed_bytes)
    throw InputError(
        name, fmt::format("a chunk of {} bytes in {}", head_.unpacked_bytes, head_.packed_bytes),
        fmt::format("at most {} times as many", kMostChunkRatio));
  const std::uint64_t left = file.size() - std::min(records_offset_, file.size());
  const std::uint64_t end = records_offset_ + std::min(head_.packed_bytes, left);
  auto packed = std::make_unique<FileStream>(file, records_offset_, end);
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

std::unique_ptr<Chunk> OpenChunks::take(std::uint64_t offset, std::uint64_t position) {
  const std::scoped_lock lock(mutex_);
  for (auto each = open_.begin(); each != open_.end(); ++each) {
    if (each->offset != offset || each->chunk->position() > position) continue;
    std::unique_ptr<Chunk> chunk = std::move(each->chunk);
    open_.erase(each);
    return chunk;
  }
  return nullptr;
}

void OpenChunks::give(std::uint64_t offset, std::unique_ptr<Chunk> chunk) {
  if (!chunk->is_packed() || chunk->position() == chunk->head().unpacked_bytes) return;
  const std::scoped_lock lock(mutex_);
  if (open_.size() == kMostOpen) open_.erase(open_.begin());
  open_.push_back({offset, std::move(chunk)});
}

void UnpackedCount::add(const Chunk& chunk) {
  if (!chunk.is_packed()) return;
  unpacked_bytes_ += std::min(chunk.head().unpacked_bytes, ~std::uint64_t{0} - unpacked_bytes_);
  const std::uint64_t most = std::max(kAlwaysUnpackedOfFile, kMostFileRatio * file_bytes_);
  if (unpacked_bytes_ > most)
    throw InputError("chunk", fmt::format("{} bytes unpacked so far", unpacked_bytes_),
                     fmt::format("at most {} of such a file", most));
}

}  // namespace stillmap::maps
