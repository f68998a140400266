#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace stillmap::localization {

/// Cells of a grid, 21 bits an axis. Coordinates are made non-negative by the caller's origin; a
/// neighbour below zero or beyond the last cell has no key.
inline constexpr std::int32_t kCellsPerAxis = 1 << 21;

[[nodiscard]] constexpr bool is_cell(std::int32_t x, std::int32_t y, std::int32_t z) {
  return ((static_cast<std::uint32_t>(x) | static_cast<std::uint32_t>(y) |
           static_cast<std::uint32_t>(z)) >>
          21) == 0;
}

[[nodiscard]] constexpr std::uint64_t cell_key(std::int32_t x, std::int32_t y, std::int32_t z) {
  return (static_cast<std::uint64_t>(x) << 42) | (static_cast<std::uint64_t>(y) << 21) |
         static_cast<std::uint64_t>(z);
}

/// Inverse of `cell_key`: x, y, z.
[[nodiscard]] constexpr std::array<std::int32_t, 3> cell_of_key(std::uint64_t key) {
  constexpr std::uint64_t kAxis = kCellsPerAxis - 1;
  return {static_cast<std::int32_t>(key >> 42 & kAxis),
          static_cast<std::int32_t>(key >> 21 & kAxis), static_cast<std::int32_t>(key & kAxis)};
}

/// Open-addressing table from cell keys to indices; linear probing at a load of at most one half,
/// so that a look-up touches one cache line most of the time. Never shrinks, never erases.
class VoxelTable {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  explicit VoxelTable(std::size_t expected = 8) { rehash(expected); }

  /// Index of a key, `kNone` if absent.
  [[nodiscard]] std::uint32_t find(std::uint64_t key) const {
    for (std::size_t slot = slot_of(key);; slot = (slot + 1) & mask_) {
      if (slots_[slot].value == kNone) return kNone;
      if (slots_[slot].key == key) return slots_[slot].value;
    }
  }

  /// Index of a key, inserted as the next number when absent; `second` tells whether it was.
  std::pair<std::uint32_t, bool> insert(std::uint64_t key) {
    if (2 * (size_ + 1) > slots_.size()) rehash(2 * size_ + 8);
    for (std::size_t slot = slot_of(key);; slot = (slot + 1) & mask_) {
      if (slots_[slot].value == kNone) {
        slots_[slot] = {key, static_cast<std::uint32_t>(size_)};
        return {static_cast<std::uint32_t>(size_++), true};
      }
      if (slots_[slot].key == key) return {slots_[slot].value, false};
    }
  }

  [[nodiscard]] std::size_t size() const { return size_; }

 private:
  struct Slot {
    std::uint64_t key = 0;
    std::uint32_t value = kNone;
  };

  [[nodiscard]] std::size_t slot_of(std::uint64_t key) const {
    // Fibonacci hashing: the top bits of the product mix all bits of the key.
    return static_cast<std::size_t>((key * 0x9E3779B97F4A7C15ULL) >> shift_);
  }

  void rehash(std::size_t expected) {
    const std::size_t capacity = std::bit_ceil(2 * expected + 16);
    std::vector<Slot> old(capacity);
    old.swap(slots_);
    mask_ = capacity - 1;
    shift_ = 64 - std::countr_zero(capacity);
    for (const Slot& kept : old) {
      if (kept.value == kNone) continue;
      std::size_t slot = slot_of(kept.key);
      while (slots_[slot].value != kNone) slot = (slot + 1) & mask_;
      slots_[slot] = kept;
    }
  }

  std::vector<Slot> slots_;
  std::size_t mask_ = 0;
  int shift_ = 0;
  std::size_t size_ = 0;
};

}  // namespace stillmap::localization
