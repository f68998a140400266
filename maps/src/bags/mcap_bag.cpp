#include "bags/mcap_bag.hpp"

#include <zlib.h>

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "bags/mcap_visitor.hpp"

namespace stillmap::maps::mcap {
namespace {

constexpr std::size_t kChecksumBytes = std::size_t{64} << 10U;
/// 48 MB of index: 10 KB each of 20 GB. With more of them the index is not used.
constexpr std::size_t kMostChunks = 2'000'000;

bool is_magic_at(const FileReader& file, std::uint64_t offset) {
  std::array<std::byte, kMagic.size()> bytes{};
  return file.read_at(offset, bytes) == bytes.size() &&
         std::memcmp(bytes.data(), kMagic.data(), bytes.size()) == 0;
}

struct Footer {
  std::uint64_t summary_start = 0;
  std::uint32_t summary_crc = 0;
};

/// @return nothing where the file does not end as it should.
std::optional<Footer> read_footer(const FileReader& file) {
  if (file.size() < 2 * kMagic.size() + kFooterBytes) return std::nullopt;
  const std::uint64_t end = file.size() - kMagic.size();
  if (!is_magic_at(file, end)) return std::nullopt;
  FileStream stream(file, end - kFooterBytes, end);
  const std::optional<RecordHead> head = next_record(stream);
  if (!head || head->op != Op::kFooter || head->length != kFooterBytes - kHeadBytes)
    return std::nullopt;
  Record record(stream, head->length);
  Footer footer;
  footer.summary_start = record.number<std::uint64_t>();
  record.skip(8);  // where the summary's offsets start
  footer.summary_crc = record.number<std::uint32_t>();
  return footer;
}

std::uint32_t crc_of(const FileReader& file, std::uint64_t begin, std::uint64_t end) {
  FileStream stream(file, begin, end);
  std::vector<std::byte> piece(kChecksumBytes);
  uLong crc = 0;
  while (const std::size_t got = stream.read(piece))
    crc = ::crc32_z(crc, reinterpret_cast<const Bytef*>(piece.data()), got);
  return static_cast<std::uint32_t>(crc);
}

/// Whether they lie in the data, one behind the other.
bool fit(const std::vector<ChunkIndex>& chunks, std::uint64_t data_end) {
  std::uint64_t behind = kMagic.size();
  for (const ChunkIndex& chunk : chunks) {
    if (chunk.offset < behind || chunk.length < kHeadBytes || chunk.offset > data_end ||
        chunk.length > data_end - chunk.offset)
      return false;
    behind = chunk.offset + chunk.length;
  }
  return true;
}

/// Whether a summary has all that the file has. Writers may leave schemas and channels out of it.
bool is_complete(const Channels& channels, const std::vector<ChunkIndex>& chunks,
                 const std::optional<Statistics>& statistics) {
  if (channels.channels.empty()) return false;
  if (statistics &&
      (statistics->chunks != chunks.size() || statistics->channels != channels.channels.size()))
    return false;
  return std::all_of(channels.channels.begin(), channels.channels.end(), [&](const auto& each) {
    return each.second.schema == 0 || channels.schemas.contains(each.second.schema);
  });
}

Serialization serialization_of(const std::string& encoding) {
  if (encoding == "cdr") return Serialization::kCdr;
  return encoding == "ros1" ? Serialization::kRos1 : Serialization::kOther;
}

}  // namespace

McapBag::McapBag(const std::filesystem::path& file, const std::filesystem::path& shown_as)
    : reader_(file, shown_as) {
  if (!is_magic_at(reader_, 0))
    throw InputError(reader_.file().string(), "no magic bytes of MCAP at its start",
                     "them: copy or record the file again");
  if (!read_summary()) {
    channels_ = {};
    chunks_.clear();
    find_channels();
  }
  set_topics();
}

/// @return whether there is an index that fits the file.
bool McapBag::read_summary() {
  const std::optional<Footer> footer = read_footer(reader_);
  if (!footer) {
    add_note("the bag has no end: it was cut off, and is read record by record");
    return false;
  }
  const std::uint64_t end = reader_.size() - kMagic.size() - kFooterBytes;
  const std::uint64_t begin = footer->summary_start;
  if (begin == 0) return false;
  const bool is_right = begin >= kMagic.size() && begin <= end &&
                        (footer->summary_crc == 0 ||
                         // Up to the CRC, in the footer.
                         crc_of(reader_, begin, end + kFooterBytes - 4) == footer->summary_crc);
  FileStream stream(reader_, begin, end);
  std::optional<Statistics> statistics;
  while (is_right && stream.position() < end) {
    const std::optional<RecordHead> head = next_record(stream);
    if (!head) break;
    Record record(stream, head->length);
    if (head->op == Op::kSchema || head->op == Op::kChannel) {
      if (!channels_.take(head->op, record)) break;
    } else if (head->op == Op::kChunkIndex) {
      const std::optional<ChunkIndex> chunk = read_chunk_index(record);
      if (!chunk || chunks_.size() == kMostChunks) break;
      chunks_.push_back(*chunk);
    } else if (head->op == Op::kStatistics) {
      statistics = read_statistics(record);
    }
    if (!record.finish()) break;
  }
  std::sort(chunks_.begin(), chunks_.end(),
            [](const ChunkIndex& a, const ChunkIndex& b) { return a.offset < b.offset; });
  // Without chunks there is nothing to know from it.
  if (is_right && stream.position() == end && chunks_.empty()) return false;
  if (is_right && stream.position() == end && fit(chunks_, begin) &&
      is_complete(channels_, chunks_, statistics))
    return true;
  add_note("the bag's index is broken or tells not all: it is read record by record");
  return false;
}

void McapBag::find_channels() {
  const Take nothing = [](const BagMessage&) {};
  Visitor visitor(reader_, {}, nothing, &channels_);
  visitor.visit_file();
}

void McapBag::set_topics() {
  for (const auto& [id, channel] : channels_.channels) {
    const auto schema = channels_.schemas.find(channel.schema);
    BagTopic topic{channel.topic,
                   schema == channels_.schemas.end() ? std::string() : ros2_type(schema->second),
                   serialization_of(channel.encoding)};
    // Each publisher has a channel of its own.
    const auto same = std::find_if(topics_.begin(), topics_.end(), [&](const BagTopic& each) {
      return each.name == topic.name && each.type == topic.type &&
             each.serialization == topic.serialization;
    });
    topic_of_channel_[id] = static_cast<std::size_t>(same - topics_.begin());
    if (same == topics_.end()) topics_.push_back(std::move(topic));
  }
}

BagDamage McapBag::visit(std::span<const std::size_t> head_bytes, const Take& take) const {
  Visitor visitor(reader_, {&topic_of_channel_, head_bytes}, take, nullptr);
  if (chunks_.empty()) {
    visitor.visit_file();
    return visitor.damage();
  }
  std::uint64_t wanted = 0;
  for (const auto& [id, topic] : topic_of_channel_)
    if (head_bytes[topic] > 0) wanted |= std::uint64_t{1} << id % 64U;
  for (const ChunkIndex& chunk : chunks_) {
    if ((chunk.channels & wanted) == 0) continue;
    FileStream stream(reader_, chunk.offset, chunk.offset + kHeadBytes);
    const std::optional<RecordHead> head = next_record(stream);
    if (head && head->op == Op::kChunk && head->length == chunk.length - kHeadBytes) {
      visitor.visit_chunk(chunk.offset + kHeadBytes, head->length);
    } else {
      visitor.add_damage(chunk.offset, "no chunk, where the index has one");
    }
  }
  return visitor.damage();
}

std::unique_ptr<Chunk> McapBag::chunk_at(std::uint64_t offset) const {
  FileStream stream(reader_, offset - kHeadBytes, offset);
  const std::optional<RecordHead> head = next_record(stream);
  const std::string name = fmt::format("{} chunk at byte {}", file().string(), offset);
  if (!head || head->op != Op::kChunk) throw InputError(name, "another record", "the chunk");
  return open_chunk(reader_, offset, head->length, name);
}

std::unique_ptr<Chunk> McapBag::take_chunk(const MessagePlace& place) const {
  std::unique_ptr<Chunk> chunk = open_.take(place.outer, place.inner);
  return chunk ? std::move(chunk) : chunk_at(place.outer);
}

bool McapBag::is_checked(std::uint64_t offset) const {
  const std::scoped_lock lock(mutex_);
  return checked_.contains(offset);
}

/// Out of a chunk that is not packed, all of which is read the first time.
std::size_t McapBag::read_and_check(Chunk& chunk, const MessagePlace& place,
                                    std::span<std::byte> into) const {
  if (chunk.head().crc == 0 || is_checked(place.outer))
    return reader_.read_at(chunk.records_offset() + place.inner, into);
  (void)chunk.read_over(place.inner - chunk.position());
  const std::size_t got = chunk.read(into);
  (void)chunk.read_over(chunk.head().unpacked_bytes - chunk.position());
  const std::string trouble = chunk.finish();
  if (trouble.starts_with("CRC"))
    throw InputError(fmt::format("{} chunk at byte {}", file().string(), place.outer), trouble,
                     "bytes as they were written: copy the bag again");
  const std::scoped_lock lock(mutex_);
  checked_.insert(place.outer);
  return got;
}

FileBytes McapBag::read(const MessagePlace& place) const {
  auto bytes = std::make_unique_for_overwrite<std::byte[]>(place.size);
  const std::span<std::byte> all(bytes.get(), place.size);
  std::size_t got = 0;
  if (place.outer == 0) {
    got = reader_.read_at(place.inner, all);
  } else {
    std::unique_ptr<Chunk> chunk = take_chunk(place);
    if (chunk->is_packed()) {
      (void)chunk->skip(place.inner - chunk->position());
      got = chunk->read(all);
      open_.give(place.outer, std::move(chunk));
    } else {
      got = read_and_check(*chunk, place, all);
    }
  }
  if (got != all.size())
    throw InputError(
        file().string(),
        fmt::format("{} bytes of a message at {} in {}", got, place.inner, place.outer),
        fmt::format("{}", all.size()));
  return {std::move(bytes), all.size()};
}

}  // namespace stillmap::maps::mcap
