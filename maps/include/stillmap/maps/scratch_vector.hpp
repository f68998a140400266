#pragma once

#include <stillmap/maps/scratch_file.hpp>

#include <cstddef>
#include <filesystem>
#include <memory>
#include <new>
#include <type_traits>
#include <utility>
#include <vector>

namespace stillmap::maps {

/// Bytes in pieces that lie in a scratch file and are mapped into memory; `rest` gives their memory
/// back, and who reads them next gets them from the file again.
class ScratchPieces {
 public:
  /// @param folder  existing; empty: the pieces lie in memory alone, and stay there.
  ScratchPieces(const std::filesystem::path& folder, std::size_t piece_bytes);
  ~ScratchPieces();
  ScratchPieces(const ScratchPieces&) = delete;
  ScratchPieces& operator=(const ScratchPieces&) = delete;

  /// @return zeros, at the beginning of a page. @throws StorageError, e.g. on a full disk;
  /// std::bad_alloc.
  void* add();
  /// Safe beside threads that read and write the pieces.
  void rest() const;

 private:
  [[nodiscard]] void* mapped();

  std::filesystem::path folder_;
  std::size_t piece_bytes_;
  std::unique_ptr<ScratchFile> file_;
  std::vector<void*> pieces_;
};

/// A vector that memory need not hold: its items stay where they are as it grows. What was appended
/// earlier rests by itself; whoever goes through many items calls `rest` now and then.
template <typename Item>
class ScratchVector {
  static_assert(std::is_trivially_destructible_v<Item>);

 public:
  /// @param folder  as of `ScratchPieces`.
  explicit ScratchVector(const std::filesystem::path& folder = {})
      : store_(std::make_unique<ScratchPieces>(folder, kPieceItems * sizeof(Item))) {}

  ScratchVector(ScratchVector&& other) noexcept { *this = std::move(other); }
  ScratchVector& operator=(ScratchVector&& other) noexcept {
    store_ = std::move(other.store_);
    pieces_ = std::exchange(other.pieces_, {});
    size_ = std::exchange(other.size_, 0);
    return *this;
  }

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  [[nodiscard]] Item& operator[](std::size_t i) {
    return pieces_[i / kPieceItems][i % kPieceItems];
  }
  [[nodiscard]] const Item& operator[](std::size_t i) const {
    return pieces_[i / kPieceItems][i % kPieceItems];
  }
  Item& push_back(const Item& item) {
    if (size_ == pieces_.size() * kPieceItems) pieces_.push_back(static_cast<Item*>(store_->add()));
    return *new (&(*this)[size_++]) Item(item);
  }
  /// Keeps the room.
  void clear() { size_ = 0; }
  void rest() const {
    if (store_) store_->rest();
  }

 private:
  /// Some megabytes; a power of two, so that numbers are divided by shifts.
  static constexpr std::size_t items_of_piece() {
    std::size_t items = 1;
    while (2 * items * sizeof(Item) <= std::size_t{1} << 22) items *= 2;
    return items;
  }
  static constexpr std::size_t kPieceItems = items_of_piece();

  std::unique_ptr<ScratchPieces> store_;
  std::vector<Item*> pieces_;
  std::size_t size_ = 0;
};

/// Whether a pass that goes through large items has come so far that they may rest.
[[nodiscard]] inline bool rests_after(std::size_t step) { return step % 4096 == 4095; }

}  // namespace stillmap::maps
