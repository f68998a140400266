#include "reference/block_grid.hpp"

#include <utility>

namespace stillmap::mapping::reference {
namespace {

std::uint64_t key_of(const Eigen::Vector3i& block) {
  return maps::signed_cell_key(block.x() >> 3, block.y() >> 3, block.z() >> 3);
}

std::size_t place_in_chunk(const Eigen::Vector3i& block) {
  return static_cast<std::size_t>((block.z() & 7) * 64 + (block.y() & 7) * 8 + (block.x() & 7));
}

}  // namespace

std::uint32_t BlockIndex::chunk_for(std::uint64_t key) {
  const auto [chunk, is_new] = table_.insert(key);
  if (is_new) {
    if (chunk == chunks_.size()) chunks_.emplace_back();
    chunks_[chunk].fill(kNone);
  }
  return chunk;
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
  const std::uint32_t chunk = table_.find(key_of(block));
  return chunk == maps::CellTable::kNone ? kNone : chunks_[chunk][place_in_chunk(block)];
}

void BlockIndex::clear() {
  table_.clear();
  blocks_.clear();
}

}  // namespace stillmap::mapping::reference
