#include "bags/mcap_visitor.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>

namespace stillmap::maps::mcap {
namespace {

/// Heads held back until a chunk's CRC is known; beyond, they are handed on before.
constexpr std::size_t kMostHeldBytes = std::size_t{16} << 20U;
constexpr std::size_t kMostHeld = 100'000;

}  // namespace

Visitor::Visitor(const FileReader& file, const Wanted& wanted, const Bag::Take& take,
                 Channels* channels)
    : file_(&file), wanted_(wanted), take_(&take), channels_(channels), unpacked_(file.size()) {}

void Visitor::add_damage(std::uint64_t offset, const std::string& what) {
  damage_.add(fmt::format("at byte {}: {}", offset, what));
}

void Visitor::visit_file() {
  FileStream stream(*file_, kMagic.size(), file_->size());
  for (;;) {
    const std::uint64_t begin = stream.position();
    const std::optional<RecordHead> head = next_record(stream);
    if (!head) return add_damage(begin, "the file ends without DataEnd or Footer");
    if (head->op == Op::kDataEnd || head->op == Op::kFooter) return;
    const std::uint64_t content = begin + kHeadBytes;
    const bool is_whole = head->length <= file_->size() - content;
    if (static_cast<std::uint8_t>(head->op) == 0)
      return add_damage(begin, "a record of opcode 0, behind which nothing is read");
    if (head->op == Op::kChunk) {
      visit_chunk(content, head->length);
    } else if (is_whole) {
      Record record(stream, head->length);
      if (head->op == Op::kMessage) {
        take_message(record, 0, content + MessageHead::kBytes);
        hand_on();
      } else if (channels_ != nullptr && (head->op == Op::kSchema || head->op == Op::kChannel)) {
        if (!channels_->take(head->op, record)) add_damage(begin, "a schema or channel cut off");
      }
    }
    if (!is_whole)
      return add_damage(begin, fmt::format("a record of {} bytes, of which there are {}",
                                           head->length, file_->size() - content));
    (void)stream.skip(content + head->length - stream.position());
  }
}

void Visitor::visit_chunk(std::uint64_t offset, std::uint64_t length) {
  std::string trouble;
  bool keep = true;
  try {
    const std::unique_ptr<Chunk> opened = open_chunk(*file_, offset, length, "chunk");
    Chunk& chunk = *opened;
    unpacked_.add(chunk);
    try {
      const bool is_whole = visit_records_of(chunk, offset);
      trouble = chunk.finish();
      if (trouble.empty() && !is_whole) trouble = "a record that goes beyond its chunk";
      // What is only cut off was right as far as it goes.
      keep = !trouble.starts_with("CRC");
    } catch (const InputError& error) {
      // What a broken packed stream gave before it broke may be anything, where a CRC would tell.
      trouble = error.what();
      keep = chunk.head().crc == 0;
    }
  } catch (const InputError& error) {
    trouble = error.what();
  }
  if (keep) hand_on();
  held_.clear();
  heads_.clear();
  if (!trouble.empty()) add_damage(offset, trouble);
}

bool Visitor::visit_records_of(Chunk& chunk, std::uint64_t offset) {
  while (const std::optional<RecordHead> head = next_record(chunk)) {
    const std::uint64_t inner = chunk.position();
    Record record(chunk, head->length);
    if (head->op == Op::kMessage) {
      take_message(record, offset, inner + MessageHead::kBytes);
    } else if (channels_ != nullptr && (head->op == Op::kSchema || head->op == Op::kChannel)) {
      if (!channels_->take(head->op, record))
        throw InputError("chunk", "a schema or channel cut off", "whole ones");
    }
    if (!record.finish()) return false;
  }
  return true;
}

void Visitor::take_message(Record& record, std::uint64_t outer, std::uint64_t inner) {
  const MessageHead head = read_message_head(record);
  if (record.is_short() || wanted_.topic_of_channel == nullptr) return;
  const auto topic = wanted_.topic_of_channel->find(head.channel);
  if (topic == wanted_.topic_of_channel->end()) return;
  const std::size_t wanted = wanted_.head_bytes[topic->second];
  const std::uint64_t size = record.left();
  if (wanted == 0) return;
  if (size > kMostMessageBytes)
    return add_damage(outer + inner, fmt::format("a message of {} bytes, expected at most {}", size,
                                                 kMostMessageBytes));
  Held held{topic->second,
            {outer, inner, static_cast<std::uint32_t>(size)},
            static_cast<std::int64_t>(head.log_time_ns),
            heads_.size(),
            0};
  held.head_bytes = static_cast<std::size_t>(std::min<std::uint64_t>(wanted, size));
  heads_.resize(heads_.size() + held.head_bytes);
  record.bytes(std::span(heads_).subspan(held.head_begin, held.head_bytes));
  if (!record.finish()) {
    heads_.resize(held.head_begin);
    return;
  }
  held_.push_back(held);
  if (heads_.size() > kMostHeldBytes || held_.size() > kMostHeld) hand_on();
}

void Visitor::hand_on() {
  for (const Held& held : held_)
    (*take_)({held.topic, held.place, held.recorded_ns,
              std::span<const std::byte>(heads_).subspan(held.head_begin, held.head_bytes)});
  held_.clear();
  heads_.clear();
}

}  // namespace stillmap::maps::mcap
