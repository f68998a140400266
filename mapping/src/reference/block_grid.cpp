#include "reference/block_grid.hpp"

#include <utility>

namespace stillmap::mapping::reference {
namespace {

/// 21 bits an axis.
std::uint64_t key_of(const Eigen::Vector3i& block) {
  const auto part = [](int value) {
    return static_cast<std::uint64_t>(static_cast<std::uint32_t>(value >> 3) & 0x1FFFFF);
  };
  return part(block.x()) | (part(block.y()) << 21) | (part(block.z()) << 42);
}

std::size_t place_in_chunk(const Eigen::Vector3i& block) {
  return static_cast<std::size_t>((block.z() & 7) * 64 + (block.y() & 7) * 8 + (block.x() & 7));
}

/// Steele, Lea, Flood, "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014: its mixer.
std::uint64_t mixed(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31);
}

}  // namespace

std::size_t BlockIndex::slot_of(std::uint64_t key) const {
  const std::size_t mask = slots_.size() - 1;
  std::size_t slot = mixed(key) & mask;
  while (slots_[slot].chunk != kNone && slots_[slot].key != key) slot = (slot + 1) & mask;
  return slot;
}

void BlockIndex::grow() {
  std::vector<Slot> old(slots_.size() * 2);
  std::swap(old, slots_);
  for (const Slot& slot : old) {
    if (slot.chunk != kNone) slots_[slot_of(slot.key)] = slot;
  }
}

std::uint32_t BlockIndex::chunk_for(std::uint64_t key) {
  std::size_t slot = slot_of(key);
  if (slots_[slot].chunk == kNone) {
    if (2 * (chunks_used_ + 1) > slots_.size()) {
      grow();
      slot = slot_of(key);
    }
    if (chunks_used_ == chunks_.size()) chunks_.emplace_back();
    chunks_[chunks_used_].fill(kNone);
    slots_[slot] = {key, static_cast<std::uint32_t>(chunks_used_++)};
  }
  return slots_[slot].chunk;
}

std::uint32_t BlockIndex::add(const Eigen::Vector3i& block, Hint& hint) {
  const std::uint64_t key = key_of(block);
  if (key != hint.key) hint = {key, chunk_for(key)};
  std::uint32_t& number = chunks_[hint.chunk][place_in_chunk(block)];
  if (number == kNone) {
    number = static_cast<std::uint32_t>(blocks_.size());
    blocks_.push_back(block);
  }
  return number;
}

std::uint32_t BlockIndex::find(const Eigen::Vector3i& block) const {
  const Slot& slot = slots_[slot_of(key_of(block))];
  return slot.chunk == kNone ? kNone : chunks_[slot.chunk][place_in_chunk(block)];
}

void BlockIndex::clear() {
  for (Slot& slot : slots_) slot.chunk = kNone;
  chunks_used_ = 0;
  blocks_.clear();
}

}  // namespace stillmap::mapping::reference
