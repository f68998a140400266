#include "bags/ros1_bag.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

namespace stillmap::maps::ros1 {
namespace {

/// 32 MB of index: 750 KB each, as rosbag writes them, of 1.5 TB. With more it is not used.
constexpr std::size_t kMostChunks = 2'000'000;

std::string place_text(std::uint64_t offset, std::string_view what) {
  return fmt::format("at byte {}: {}", offset, what);
}

}  // namespace

/// Goes through the records of a bag and hands on the wanted messages.
class Ros1Bag::Visit {
 public:
  /// @param head_bytes   one a topic; empty = no messages are wanted.
  /// @param connections  to be filled with what comes by, or null.
  Visit(const Ros1Bag& bag, std::span<const std::size_t> head_bytes, const Take& take,
        Connections* connections)
      : bag_(bag),
        head_bytes_(head_bytes),
        take_(take),
        connections_(connections),
        unpacked_(bag.reader_.size()) {}

  /// All records from the first on, as far as they go.
  void all() {
    const FileReader& file = bag_.reader_;
    FileStream stream(file, kMagic.size(), file.size());
    while (stream.position() < file.size()) {
      const std::uint64_t begin = stream.position();
      try {
        const std::optional<RecordHead> head = next_record(stream);
        const std::uint64_t data = stream.position();
        if (!head || head->data_bytes > file.size() - data) {
          if (head && head->op == Op::kChunk) chunk(*head, begin, data);
          return damage_.add(place_text(begin, "the bag ends within a record"));
        }
        if (head->op == Op::kChunk)
          chunk(*head, begin, data);
        else
          record(*head, stream, {0, data});
        (void)stream.skip(data + head->data_bytes - stream.position());
      } catch (const InputError& error) {
        return damage_.add(place_text(begin, error.what()));
      }
    }
  }

  /// One chunk, whose record is at `offset`.
  void chunk_at(std::uint64_t offset) {
    try {
      FileStream stream(bag_.reader_, offset, bag_.reader_.size());
      const std::optional<RecordHead> head = next_record(stream);
      if (!head || head->op != Op::kChunk)
        return damage_.add(place_text(offset, "no chunk, where the index has one"));
      chunk(*head, offset, stream.position());
    } catch (const InputError& error) {
      damage_.add(place_text(offset, error.what()));
    }
  }

  [[nodiscard]] const BagDamage& damage() const { return damage_; }

 private:
  /// @param offset, data  of its record and of the record's data in the file.
  void chunk(const RecordHead& head, std::uint64_t offset, std::uint64_t data) {
    try {
      const std::unique_ptr<Chunk> chunk = open_chunk(bag_.reader_, head, data, "chunk");
      unpacked_.add(*chunk);
      while (const std::optional<RecordHead> next = next_record(*chunk)) {
        const std::uint64_t inner = chunk->position();
        // What is not packed is read from the file itself.
        const MessagePlace place =
            chunk->is_packed() ? MessagePlace{offset, inner} : MessagePlace{0, data + inner};
        record(*next, *chunk, place);
        const std::uint64_t left = inner + next->data_bytes - chunk->position();
        if (chunk->skip(left) < left) break;
      }
      if (chunk->position() < chunk->head().unpacked_bytes)
        damage_.add(
            place_text(offset, fmt::format("a chunk cut off after {} of {} bytes",
                                           chunk->position(), chunk->head().unpacked_bytes)));
    } catch (const InputError& error) {
      damage_.add(place_text(offset, error.what()));
    }
  }

  /// A message or a connection, with the stream at its data. @param at  of the data.
  void record(const RecordHead& head, ByteStream& stream, MessagePlace at) {
    if (head.op == Op::kConnection && connections_ != nullptr) {
      if (!connections_->take(head, stream))
        throw InputError("connection", "a broken one", "one with topic and type");
    } else if (head.op == Op::kMessage && !head_bytes_.empty()) {
      message(head, stream, at);
    }
  }

  void message(const RecordHead& head, ByteStream& stream, MessagePlace at) {
    const auto connection = head.fields.number<std::uint32_t>("conn");
    if (!connection) return;
    const auto topic = bag_.topic_of_connection_.find(*connection);
    if (topic == bag_.topic_of_connection_.end()) return;
    const std::size_t wanted = head_bytes_[topic->second];
    if (wanted == 0) return;
    if (head.data_bytes > kMostMessageBytes)
      return damage_.add(
          place_text(at.outer + at.inner, fmt::format("a message of {} bytes, expected at most {}",
                                                      head.data_bytes, kMostMessageBytes)));
    message_.resize(std::min<std::size_t>(wanted, head.data_bytes));
    if (stream.read(message_) != message_.size()) return;
    // The rest of it must be there too.
    const std::uint64_t rest = head.data_bytes - message_.size();
    if (stream.skip(rest) < rest) return;
    at.size = head.data_bytes;
    take_({topic->second, at, recorded_ns(head), message_});
  }

  /// Seconds, then nanoseconds; 0 where the record has no time.
  static std::int64_t recorded_ns(const RecordHead& head) {
    const std::uint64_t time = head.fields.number<std::uint64_t>("time").value_or(0);
    return static_cast<std::int64_t>(time & 0xffffffffU) * 1'000'000'000 +
           static_cast<std::int64_t>(time >> 32U);
  }

  const Ros1Bag& bag_;
  std::span<const std::size_t> head_bytes_;
  const Take& take_;
  Connections* connections_;
  UnpackedCount unpacked_;
  BagDamage damage_;
  std::vector<std::byte> message_;
};

Ros1Bag::Ros1Bag(const std::filesystem::path& file, const std::filesystem::path& shown_as)
    : reader_(file, shown_as) {
  std::array<std::byte, kMagic.size()> magic{};
  if (reader_.read_at(0, magic) != magic.size() ||
      std::memcmp(magic.data(), kMagic.data(), magic.size()) != 0)
    throw InputError(
        reader_.file().string(), "no first line '#ROSBAG V2.0'",
        "a bag of ROS 1, format 2.0: copy one of an older format with 'rosbag filter OLD.bag "
        "NEW.bag True'");
  if (!read_index()) {
    connections_ = {};
    chunks_.clear();
    find_connections();
  }
  set_topics();
}

/// @return whether there is an index that fits the file.
bool Ros1Bag::read_index() {
  FileStream start(reader_, kMagic.size(), reader_.size());
  std::optional<RecordHead> head;
  try {
    head = next_record(start);
  } catch (const InputError&) {
    // What is there is no header; the visit says so.
  }
  const bool is_header = head && head->op == Op::kBagHeader;
  if (is_header && !head->fields.text("encryptor").empty())
    throw InputError(file().string(), "an encrypted bag",
                     "a plain one: run 'rosbag decrypt' on it");
  const std::uint64_t index =
      is_header ? head->fields.number<std::uint64_t>("index_pos").value_or(0) : 0;
  if (index == 0) {
    add_note(
        "the bag has no index: its recording was cut off; it is read record by record ('rosbag "
        "reindex' makes the index)");
    return false;
  }
  if (read_index_at(index) && head->fields.number<std::uint32_t>("chunk_count") == chunks_.size() &&
      head->fields.number<std::uint32_t>("conn_count") == connections_.by_id.size() &&
      !chunks_.empty())
    return true;
  add_note("the bag's index is broken or does not tell all: it is read record by record");
  return false;
}

/// @return whether there are whole records of an index up to the end of the file.
bool Ros1Bag::read_index_at(std::uint64_t index) try {
  FileStream stream(reader_, std::min(index, reader_.size()), reader_.size());
  while (const std::optional<RecordHead> head = next_record(stream)) {
    const std::uint64_t data = stream.position();
    if (head->op == Op::kConnection) {
      if (!connections_.take(*head, stream)) return false;
    } else if (head->op == Op::kChunkInfo) {
      const std::optional<ChunkInfo> info = read_chunk_info(*head, stream);
      if (!info || info->offset >= index || chunks_.size() == kMostChunks) return false;
      chunks_.push_back(*info);
    }
    (void)stream.skip(data + head->data_bytes - stream.position());
  }
  std::ranges::sort(chunks_, {}, &ChunkInfo::offset);
  return stream.position() == reader_.size();
} catch (const InputError&) {
  return false;  // what is there is no index
}

void Ros1Bag::find_connections() {
  const Take nothing = [](const BagMessage&) {};
  Visit(*this, {}, nothing, &connections_).all();
}

void Ros1Bag::set_topics() {
  for (const auto& [id, connection] : connections_.by_id) {
    BagTopic topic{connection.topic, ros2_type(connection.type), Serialization::kRos1};
    // Each publisher has a connection of its own.
    const auto same = std::ranges::find_if(topics_, [&](const BagTopic& each) {
      return each.name == topic.name && each.type == topic.type;
    });
    topic_of_connection_[id] = static_cast<std::size_t>(same - topics_.begin());
    if (same == topics_.end()) topics_.push_back(std::move(topic));
  }
}

BagDamage Ros1Bag::visit(std::span<const std::size_t> head_bytes, const Take& take) const {
  Visit visit(*this, head_bytes, take, nullptr);
  if (chunks_.empty()) {
    visit.all();
    return visit.damage();
  }
  std::uint64_t wanted = 0;
  for (const auto& [id, topic] : topic_of_connection_)
    if (head_bytes[topic] > 0) wanted |= std::uint64_t{1} << id % 64U;
  for (const ChunkInfo& chunk : chunks_)
    if ((chunk.connections & wanted) != 0) visit.chunk_at(chunk.offset);
  return visit.damage();
}

std::unique_ptr<Chunk> Ros1Bag::chunk_at(std::uint64_t offset) const {
  FileStream stream(reader_, offset, reader_.size());
  const std::string name = fmt::format("{} chunk at byte {}", file().string(), offset);
  const std::optional<RecordHead> head = next_record(stream);
  if (!head || head->op != Op::kChunk) throw InputError(name, "another record", "the chunk");
  return open_chunk(reader_, *head, stream.position(), name);
}

FileBytes Ros1Bag::read(const MessagePlace& place) const {
  auto bytes = std::make_unique_for_overwrite<std::byte[]>(place.size);
  const std::span<std::byte> all(bytes.get(), place.size);
  std::size_t got = 0;
  if (place.outer == 0) {
    got = reader_.read_at(place.inner, all);
  } else {
    std::unique_ptr<Chunk> chunk = open_.take(place.outer, place.inner);
    if (!chunk) chunk = chunk_at(place.outer);
    (void)chunk->skip(place.inner - chunk->position());
    got = chunk->read(all);
    open_.give(place.outer, std::move(chunk));
  }
  if (got != all.size())
    throw InputError(
        file().string(),
        fmt::format("{} bytes of a message at {} in {}", got, place.inner, place.outer),
        fmt::format("{}; the bag changed or was cut off while it was read", all.size()));
  return {std::move(bytes), all.size()};
}

}  // namespace stillmap::maps::ros1
