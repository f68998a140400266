#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

// C++17 and the standard library alone: clients include it, too.
// The one hash table for cells of a grid: keys of cells, and three tables that number or hold what
// lies in them in the order in which it came, so that no result depends on a hash.
//   CellTable  key -> number; keys lie in the slots: the fastest look-up, 24 to 32 bytes a cell
//   CellIndex  key -> number; keys lie with the caller's values: 4 to 8 bytes a cell
//   CellMap    key -> value, on a CellIndex
namespace stillmap::maps {

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

/// Key of a cell that may lie on either side of the origin, 63 bits. Its own within 2^20 cells of
/// the origin on each axis; cells farther out share keys with nearer ones. Keys are in the order of
/// x, then y, then z.
[[nodiscard]] constexpr std::uint64_t signed_cell_key(std::int64_t x, std::int64_t y,
                                                      std::int64_t z) {
  constexpr std::int64_t kHalf = kCellsPerAxis / 2;
  constexpr std::uint64_t kAxis = kCellsPerAxis - 1;
  return (static_cast<std::uint64_t>(x + kHalf) & kAxis) << 42 |
         (static_cast<std::uint64_t>(y + kHalf) & kAxis) << 21 |
         (static_cast<std::uint64_t>(z + kHalf) & kAxis);
}

/// Inverse of `signed_cell_key` within its bounds.
[[nodiscard]] constexpr std::array<std::int32_t, 3> signed_cell_of_key(std::uint64_t key) {
  std::array<std::int32_t, 3> cell = cell_of_key(key);
  for (std::int32_t& axis : cell) axis -= kCellsPerAxis / 2;
  return cell;
}

/// Key of a cell of a plane, 32 bits an axis.
[[nodiscard]] constexpr std::uint64_t plane_cell_key(std::int64_t x, std::int64_t y) {
  return static_cast<std::uint64_t>(x) << 32 | (static_cast<std::uint64_t>(y) & 0xFFFFFFFFU);
}

/// Fibonacci hashing: the top bits of the product mix all bits of the key.
[[nodiscard]] constexpr std::uint64_t hash_of_cell(std::uint64_t key) {
  return key * 0x9E3779B97F4A7C15ULL;
}

/// Slots of a table for so many cells: a power of two, and by how much a hash is shifted to be one.
struct SlotCount {
  std::size_t slots = 32;
  int shift = 59;
};
[[nodiscard]] constexpr SlotCount slots_for(std::size_t cells) {
  SlotCount count;
  for (; count.slots < 2 * cells + 16; count.slots *= 2) --count.shift;
  return count;
}

/// Open-addressing table from cell keys to numbers 0, 1, ... in the order in which the keys came;
/// linear probing at a load of at most one half, so that a look-up touches one cache line most of
/// the time. Never shrinks, never erases.
class CellTable {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  explicit CellTable(std::size_t expected = 8) { rehash(expected); }

  /// Number of a key, `kNone` if absent.
  [[nodiscard]] std::uint32_t find(std::uint64_t key) const {
    for (std::size_t slot = slot_of(key);; slot = (slot + 1) & mask_) {
      if (slots_[slot].value == kNone) return kNone;
      if (slots_[slot].key == key) return slots_[slot].value;
    }
  }
  [[nodiscard]] bool contains(std::uint64_t key) const { return find(key) != kNone; }

  /// Number of a key, inserted as the next number when absent; `second` tells whether it was.
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
  /// Forgets the keys and keeps the memory.
  void clear() {
    slots_.assign(slots_.size(), {});
    size_ = 0;
  }

 private:
  struct Slot {
    std::uint64_t key = 0;
    std::uint32_t value = kNone;
  };

  [[nodiscard]] std::size_t slot_of(std::uint64_t key) const {
    return static_cast<std::size_t>(hash_of_cell(key) >> shift_);
  }

  void rehash(std::size_t expected) {
    const SlotCount count = slots_for(expected);
    std::vector<Slot> old(count.slots);
    old.swap(slots_);
    mask_ = count.slots - 1;
    shift_ = count.shift;
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

/// As CellTable, but the caller stores the keys. It needs less memory, which matters for large
/// tables. `key_at(number)` must return the key that `insert` gave this number.
class CellIndex {
 public:
  static constexpr std::uint32_t kNone = CellTable::kNone;

  explicit CellIndex(std::size_t expected = 8) { resize(expected); }

  template <typename KeyAt>
  [[nodiscard]] std::uint32_t find(std::uint64_t key, const KeyAt& key_at) const {
    return slots_[slot_of(key, key_at)];
  }

  /// Number of a key. If `second` is true, the number is new, and the caller must store the key.
  template <typename KeyAt>
  std::pair<std::uint32_t, bool> insert(std::uint64_t key, const KeyAt& key_at) {
    if (2 * (size_ + 1) > slots_.size()) {
      resize(size_ + 1);
      for (std::uint32_t number = 0; number < size_; ++number)
        slots_[slot_of(key_at(number), key_at)] = number;
    }
    std::uint32_t& number = slots_[slot_of(key, key_at)];
    if (number != kNone) return {number, false};
    number = static_cast<std::uint32_t>(size_++);
    return {number, true};
  }

  [[nodiscard]] std::size_t size() const { return size_; }

 private:
  template <typename KeyAt>
  [[nodiscard]] std::size_t slot_of(std::uint64_t key, const KeyAt& key_at) const {
    std::size_t slot = static_cast<std::size_t>(hash_of_cell(key) >> shift_);
    while (slots_[slot] != kNone && key_at(slots_[slot]) != key) slot = (slot + 1) & mask_;
    return slot;
  }

  void resize(std::size_t expected) {
    const SlotCount count = slots_for(expected);
    slots_.assign(count.slots, kNone);
    mask_ = count.slots - 1;
    shift_ = count.shift;
  }

  std::vector<std::uint32_t> slots_;
  std::size_t mask_ = 0;
  int shift_ = 0;
  std::size_t size_ = 0;
};

/// Values by cell, in the order in which the cells came. References are valid until the next cell
/// is added.
template <typename Value>
class CellMap {
 public:
  struct Entry {
    std::uint64_t key = 0;
    Value value{};
  };

  /// @param expected cells: makes room for the look-up, not for the values.
  explicit CellMap(std::size_t expected = 8) : index_(expected) {}

  /// The value of a cell; a new one when it had none.
  Value& operator[](std::uint64_t key) { return *insert(key, {}).first; }
  /// The value of a cell: the one given when it had none, which `second` tells.
  std::pair<Value*, bool> insert(std::uint64_t key, Value value) {
    const auto [number, is_new] = index_.insert(key, key_at());
    if (is_new) entries_.push_back({key, std::move(value)});
    return {&entries_[number].value, is_new};
  }

  /// Null for a cell without a value.
  [[nodiscard]] const Value* find(std::uint64_t key) const {
    const std::uint32_t number = index_.find(key, key_at());
    return number == CellIndex::kNone ? nullptr : &entries_[number].value;
  }
  [[nodiscard]] Value* find(std::uint64_t key) {
    return const_cast<Value*>(std::as_const(*this).find(key));
  }

  [[nodiscard]] std::size_t size() const { return entries_.size(); }
  [[nodiscard]] bool empty() const { return entries_.empty(); }
  [[nodiscard]] auto begin() const { return entries_.begin(); }
  [[nodiscard]] auto end() const { return entries_.end(); }
  [[nodiscard]] auto begin() { return entries_.begin(); }
  [[nodiscard]] auto end() { return entries_.end(); }
  void clear() { *this = CellMap(); }

 private:
  [[nodiscard]] auto key_at() const {
    return [this](std::uint32_t number) { return entries_[number].key; };
  }

  CellIndex index_;
  std::vector<Entry> entries_;
};

}  // namespace stillmap::maps
